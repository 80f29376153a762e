//! `modulo eval`: every frame once through the nodes of a launch file, for each combination of what varies; and the report of it.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, anyhow, bail};
use clap::{Args, Subcommand};
use modulo_bags::source::{SourceError, is_endless};
use modulo_core::{SensorError, UnwrapError, WorkersError};
use modulo_eval::plan::{PlannedNode, Variant};
use modulo_eval::progress::{GridEvent, Listener};
use modulo_eval::recordings::{RecordOptions, Recordings};
use modulo_eval::results::{Cell, Results};
use modulo_eval::run::{Evaluation, Request};
use modulo_eval::score::{ScoreOptions, score};
use modulo_eval::store::{Folder, figures, save};
use modulo_eval::variants::{Axes, Resolve};
use modulo_eval::{GridError, below_100, coco, report};
use modulo_images::ImageError;
use modulo_launch::Plan;
use modulo_middleware::process::signals::first_signal;
use modulo_runtime::output::ResultFolder;
use modulo_runtime::{Parameters, SystemClock, Value};
use modulo_video::VideoAddress;

use super::launch::{prepare, refuse, warn_of_demo};
use super::progress::{FrameProgress, ProgressLine};
use super::{completion, images, pairs, start_log, usage};
use crate::{Ended, Failure, message_of};

/// The launch file of an evaluation that names none.
const COMPARE: &str = "compare.launch.yaml";

#[derive(Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Eval {
    /// Command for existing results
    #[command(subcommand)]
    pub verb: Option<Verb>,
    /// Launch file (ROS 2 YAML) with one camera or several [default: compare.launch.yaml]
    #[arg(add = completion::files())]
    pub file: Option<PathBuf>,
    /// Arguments of the launch file as name:=value
    #[arg(requires = "file", add = completion::arguments())]
    pub arguments: Vec<String>,
    /// What varies, the frames, and what is done with them.
    #[command(flatten)]
    pub request: Request,
    /// What is recorded beside the results.
    #[command(flatten)]
    pub record: RecordOptions,
    /// Also print what the nodes log, with one line for each frame
    #[arg(long, short)]
    pub verbose: bool,
    /// Short forms of --vary.
    #[command(flatten)]
    pub axes: Axes,
}

#[derive(Subcommand)]
pub enum Verb {
    /// Score what lies in folders, and write the report into the first one
    Report {
        /// Folders of one evaluation, such as those of its slices
        #[arg(required = true)]
        folders: Vec<PathBuf>,
        /// How the boxes are scored.
        #[command(flatten)]
        score: ScoreOptions,
        /// Also write labels and boxes into this new folder, as COCO annotations and results
        #[arg(long, value_name = "FOLDER")]
        coco: Option<PathBuf>,
    },
    /// Run every unwrapping method on scenes that are hard to unwrap, and compare the results with the expected ones
    Stability {
        /// Folder for results.json and the pictures; without it a new one in runs
        #[arg(short, long, value_name = "FOLDER")]
        out: Option<PathBuf>,
    },
}

pub fn eval(args: &Eval) -> Result<Ended, Failure> {
    start_log(if args.verbose { "debug" } else { "warn" });
    match &args.verb {
        Some(Verb::Report { folders, score, coco }) => return show(folders, score, coco.as_deref()),
        Some(Verb::Stability { out }) => return images::stability(out.as_deref()),
        None => {}
    }
    let request = &args.request;
    let file = args.file.clone().unwrap_or_else(|| PathBuf::from(COMPARE));
    let file = modulo_launch::launch_file(&file).map_err(usage)?;
    let (arguments, named) = (pairs(&args.arguments)?, request.data.named());
    if args.file.is_none() && named.is_none() {
        return Err(usage(anyhow!(
            "nothing to evaluate: give a launch file, or one of --kitti, --sequence, --yolo, --coco, --source"
        )));
    }
    let nodes = |more: &[(String, String)]| {
        let planned = planned(&file, &[&arguments[..], more].concat(), named.is_some());
        planned.map_err(|(Failure::Usage(why) | Failure::Run(why))| GridError::Request(message_of(&why)))
    };
    let variants = args.axes.variants(&nodes, &request.vary, args.file.is_none()).map_err(failure)?;
    let out = Folder::take(request.out.as_deref()).map_err(failure)?;
    let mut evaluation = Evaluation::new(request, &variants).map_err(failure)?;
    tell_demo(&variants, named.as_deref());
    // What cannot be evaluated leaves no recording behind.
    let recordings = Recordings::create(&args.record, &variants, out.path()).map_err(failure)?;
    let asked = first_signal().context("signal handlers")?;
    let timer = SystemClock::default();
    let stopped = || asked.load(Ordering::Relaxed);
    let results =
        with_progress(|tell| evaluation.run(out.path(), &timer, &Listener { tell, stopped: &stopped }))?;
    recordings.map_or(Ok(()), |recordings| record(recordings, &request.data.source, &nodes, &asked))?;
    if !stopped() {
        picture(evaluation, out.path(), &results)?;
    }
    finish(&results, &write(out.path(), &results)?, stopped())
}

/// Warns where the embedded model is to look at other frames than rendered ones.
fn tell_demo(variants: &[Variant], named: Option<&[String]>) {
    let parameters = variants.iter().flat_map(|variant| &variant.nodes).map(|node| node.parameters.clone());
    warn_of_demo(&parameters.collect::<Vec<_>>(), named);
}

/// Runs the nodes for `recordings`, source after source.
fn record(
    mut recordings: Recordings,
    sources: &[String],
    nodes: &Resolve<'_>,
    asked: &AtomicBool,
) -> Result<(), Failure> {
    let mut runs: Vec<_> = sources.iter().map(|source| vec![("source".to_owned(), source.clone())]).collect();
    if runs.is_empty() {
        runs.push(Vec::new());
    }
    for run in runs {
        let (planned, line) = (nodes(&run).map_err(failure)?, ProgressLine::start());
        let recorded = recordings.record(&planned, &SystemClock::default(), &|chain| {
            line.show(|| chain.reports());
            if asked.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        recorded.map_err(|why| anyhow!(why))?;
    }
    Ok(recordings.finish().map_err(|why| anyhow!(why))?)
}

/// Draws the frame in which the streams differ most.
fn picture(evaluation: Evaluation<'_>, out: &Path, results: &Results) -> Result<(), Failure> {
    if let Some(title) = evaluation.draw(out, &SystemClock::default(), results).map_err(failure)? {
        let file = out.join(report::GRID);
        note!("the frame in which the streams differ most ({title}): {}", file.display());
    }
    Ok(())
}

/// Writes what follows from the files of a folder.
fn write(folder: &Path, results: &Results) -> Result<PathBuf, Failure> {
    save(folder, results).map_err(failure)?;
    report::write(folder, results).map_err(failure)
}

/// Prints the figures of the cells and the verdict.
fn finish(results: &Results, page: &Path, stopped: bool) -> Result<Ended, Failure> {
    results.cells.iter().for_each(print_cell);
    results.verdict.iter().for_each(|verdict| say!("{verdict}"));
    if results.input.labelled == 0 && results.verdict.is_none() {
        note!(
            "modulo: no frame has labels, and no stream ideal was evaluated as a reference, so that there is no AP"
        );
    } else if results.cells.iter().any(Cell::is_unscored) {
        note!(
            "modulo: no labelled object is scored, so that there is no AP; --groups names the classes that are scored, and \
             --difficulty the objects"
        );
    }
    if stopped {
        note!("modulo: stopped by a signal; the same command goes on with the frames that are missing");
    }
    say!("{}", page.display());
    Ok(Ended::of(results.lost() || stopped))
}

/// Scores the results in `folders`.
fn show(folders: &[PathBuf], options: &ScoreOptions, coco: Option<&Path>) -> Result<Ended, Failure> {
    let [first, ..] = folders else { unreachable!("the command line needs a folder") };
    if let Some(results) = figures(first).map_err(failure)? {
        let page = report::write(first, &results).map_err(failure)?;
        return finish(&results, &page, false);
    }
    let opened = folders.iter().map(|folder| Folder::existing(folder)).collect::<Result<Vec<_>, _>>();
    let opened = opened.map_err(failure)?;
    let results = score(&opened, options).map_err(failure)?;
    if let Some(out) = coco {
        let taken = ResultFolder::take(Some(out), "coco", None).map_err(usage)?;
        coco::export(&opened, options, taken.path()).map_err(failure)?;
    }
    finish(&results, &write(first, &results)?, false)
}

/// What the command line names is a matter of its own; the others come from results or from the run.
fn failure(why: GridError) -> Failure {
    let of_command_line = match &why {
        GridError::Request(_)
        | GridError::Parameter(_)
        | GridError::Detector(_)
        | GridError::Source(_)
        | GridError::Output(_)
        | GridError::NotCodes(..)
        | GridError::Video(_)
        | GridError::Image(ImageError::Coding(..))
        | GridError::Unwrap(UnwrapError::Method { .. } | UnwrapError::Workers(WorkersError::Threads(_))) => {
            true
        }
        GridError::Sensor(why) => !matches!(why, SensorError::Shape(_) | SensorError::NotFinite(..)),
        _ => false,
    };
    if of_command_line { usage(why) } else { why.into() }
}

/// Runs `work` and shows its progress.
pub(super) fn with_progress<T>(
    work: impl FnOnce(&(dyn Fn(GridEvent<'_>) + Sync)) -> Result<T, GridError>,
) -> Result<T, Failure> {
    let progress = FrameProgress::new();
    let done = work(&|event| match event {
        GridEvent::Cell { frames, name } => progress.begin(frames, name),
        GridEvent::Frame => progress.frame(),
        GridEvent::Warning(warning) => progress.warn(warning),
    });
    let done = done.map_err(failure)?;
    progress.end();
    Ok(done)
}

fn print_cell(cell: &Cell) {
    let percent =
        |value: Option<f64>| value.map_or("    -".to_owned(), |value| format!("{:>5}", below_100(value, 1)));
    let group = |(group, ap): (&String, &Option<f64>)| {
        // A group without an object in the data has no AP, which says nothing.
        let bounds = cell
            .interval_of(group)
            .filter(|_| ap.is_some())
            .map(|bounds| format!(" [{}]", bounds.map(|bound| below_100(bound, 1)).join(", ")));
        Some(format!("{group} {}{}", percent(Some((*ap)?)), bounds.unwrap_or_default()))
    };
    let groups: Vec<String> = cell.ap50.iter().filter_map(group).collect();
    say!(
        "{:<64} AP50 {}  exact k {}  infer {}",
        cell.point.to_string(),
        if groups.is_empty() { "-".to_owned() } else { groups.join(" ") },
        percent(cell.exact_k),
        // Without --time-frames, no time is measured.
        cell.latency_ms.get("infer").map_or("-".to_owned(), |infer| format!("{:.1} ms", infer.p50))
    );
    if !cell.unknown.is_empty() {
        let unknown: Vec<_> =
            cell.unknown.iter().map(|(group, count)| format!("{group} ({count})")).collect();
        say!("  the model has no class for {}, which are not scored", unknown.join(", "));
    }
    if cell.unanswered > 0 {
        say!("  {} frames have no answer, and count as frames without a box", cell.unanswered);
    }
}

/// Returns the nodes of a launch file. `has_frames`: whether the frames are not those of its cameras.
fn planned(
    file: &Path,
    arguments: &[(String, String)],
    has_frames: bool,
) -> Result<Vec<PlannedNode>, Failure> {
    let plan = modulo_launch::resolve(file, arguments).map_err(usage)?;
    refuse(&plan)?;
    evaluable(&plan, has_frames).map_err(usage)
}

/// Returns the nodes of a plan, if lockstep can run them to an end.
pub(super) fn evaluable(plan: &Plan, has_frames: bool) -> anyhow::Result<Vec<PlannedNode>> {
    let node = |node| {
        let (kind, name, parameters) = prepare(node)?;
        if let Some(Value::String(source)) = parameters.get("source").filter(|_| !has_frames) {
            check_source(source, &parameters).with_context(|| name.fully_qualified())?;
        }
        Ok(PlannedNode { executable: kind.name, name, parameters })
    };
    let nodes = modulo_launch::compose(plan).map_err(|why| {
        anyhow!("{why}; an evaluation runs nodes of the suite only, and takes the frames of a bag as the source of a camera")
    })?;
    nodes.iter().map(node).collect()
}

/// Refuses a source of a camera that lockstep cannot read, or that has no end.
fn check_source(source: &str, parameters: &Parameters) -> anyhow::Result<()> {
    if let Some(VideoAddress::Live(address)) = VideoAddress::of(source)? {
        bail!(SourceError::Live(address));
    }
    if source.starts_with("topic:") {
        bail!(
            "{source}: is a topic of a running stack, which only modulo launch reads; record it with modulo bag record, and give the bag"
        );
    }
    let what = match parameters.get("loop") {
        Some(Value::Bool(true)) => "loop:=true",
        _ if is_endless(source) => source,
        _ => return Ok(()),
    };
    if parameters.get("frames") == Some(&Value::Integer(0)) {
        bail!(
            "{what} has no end, but an evaluation needs one; give the number of frames as well, such as frames:=60"
        );
    }
    Ok(())
}
