//! `modulo eval FILE`: runs the nodes of a launch file in lockstep. Without FILE it runs the grid.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, anyhow, bail};
use clap::{Args, Subcommand};
use modulo_bags::bag::{BagWriter, Compression};
use modulo_bags::source::{SourceError, is_endless};
use modulo_eval::launch_file::{Evaluation, EvaluationPlan, GRID, NamedNodes, Recordings, StreamResult};
use modulo_eval::report::PAGE;
use modulo_eval::results::RESULTS;
use modulo_eval::video::AnnotatedVideo;
use modulo_launch::{Plan, Summary};
use modulo_middleware::process::signals::first_signal;
use modulo_runtime::lockstep::Lockstep;
use modulo_runtime::output::{OutputError, ResultFolder, prepare_file};
use modulo_runtime::{NodeName, NodeReport, Parameters, SystemClock, Value};
use modulo_video::VideoAddress;

use super::colour::say_summary;
use super::launch::{prepare, refuse, tell_slower_engine};
use super::progress::ProgressLine;
use super::run::NodeKind;
use super::{completion, grid, pairs, start_log, usage};
use crate::{Ended, Failure, message_of};

#[derive(Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Eval {
    /// Command for existing results
    #[command(subcommand)]
    pub verb: Option<Verb>,
    /// Launch file (ROS 2 YAML) with one camera or several. Without it: a grid over --kitti, --sequence, --yolo, --coco or
    /// --source
    #[arg(conflicts_with = "LabelledFrames", add = completion::files())]
    pub file: Option<PathBuf>,
    /// Arguments of the launch file as name:=value
    #[arg(requires = "file", add = completion::arguments())]
    pub arguments: Vec<String>,
    /// Source of frames, such as a bag, a video or scene://PRESET: for the grid, or instead of the source in FILE (repeatable)
    #[arg(long, value_name = "SOURCE")]
    pub source: Vec<String>,
    /// Folder for the results; without it a new one in runs
    #[arg(short, long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    /// New bag folder for the messages on --topics; with FILE
    #[arg(long, value_name = "FOLDER", requires_all = ["topics", "file"])]
    pub bag: Option<PathBuf>,
    /// Topics for --bag
    #[arg(long, value_name = "TOPIC", num_args = 1.., requires = "bag")]
    pub topics: Vec<String>,
    /// Also write every image that a detector gets as PNG; with FILE
    #[arg(long, requires = "file")]
    pub images: bool,
    /// Write all streams with their boxes into this video, such as out.mp4, with the method and the trust of each frame; with FILE (needs
    /// ffmpeg)
    #[arg(long, value_name = "VIDEO", requires = "file")]
    pub video: Option<PathBuf>,
    /// Also print what the nodes log, with one line for each frame
    #[arg(long, short)]
    pub verbose: bool,
    #[command(flatten)]
    pub grid: grid::Grid,
}

#[derive(Subcommand)]
pub enum Verb {
    /// Draw charts and report of the results in a folder again
    Report {
        /// Folder with results.json
        folder: PathBuf,
    },
}

pub fn eval(args: &Eval) -> Result<Ended, Failure> {
    start_log(if args.verbose { "debug" } else { "warn" });
    if let Some(Verb::Report { folder }) = &args.verb {
        return grid::report(folder);
    }
    let out = |continued| ResultFolder::take(args.out.as_deref(), "eval", continued).map_err(usage);
    match &args.file {
        Some(file) => launch_file(args, &modulo_launch::launch_file(file).map_err(usage)?, out(None)?.path()),
        // A grid goes on where an earlier run has ended.
        None => grid::grid(&args.grid, &args.source, out(Some(RESULTS))?.path()),
    }
}

/// Name of the file with the counts of the run.
const SUMMARY: &str = "summary.json";

/// Runs every frame of the cameras of the file, or of each `--source`, through the nodes, and writes boxes and scores.
fn launch_file(args: &Eval, file: &Path, out: &Path) -> Result<Ended, Failure> {
    let arguments = pairs(&args.arguments)?;
    let of_source = |source: &String| [&arguments[..], &[("source".to_owned(), source.clone())]].concat();
    let mut runs: Vec<_> = args.source.iter().map(of_source).collect();
    if runs.is_empty() {
        runs.push(arguments.clone());
    }
    let mut made = Some(nodes(file, &runs[0], false)?);
    // Opened, and closed again: a source that is not there must be known now and not after the frames of those before it.
    runs[1..].iter().try_for_each(|run| nodes(file, run, true).map(drop))?;
    let plan = |made: &NamedNodes| {
        let plan = EvaluationPlan::new(made, args.topics.clone());
        plan.map_err(|why| usage(anyhow!(why).context(file.display().to_string())))
    };
    let mut recordings =
        made.as_ref().map(|made| outputs(args, out, &plan(made)?)).expect("the first run is made")?;
    let asked = first_signal().context("signal handlers")?;
    let mut evaluation = Evaluation::new(args.grid.options.difficulty.unwrap_or_default());
    let (mut reports, mut ended) = (Vec::new(), Ok(()));
    // All sources add to the same evaluation, so that the scores count over all frames and not over sources.
    for run in &runs {
        let made = made.take().map_or_else(|| nodes(file, run, false), Ok);
        ended = made.and_then(|made| {
            let plan = plan(&made)?;
            add(made, &plan, (&mut evaluation, &mut recordings), &asked, &mut reports)
        });
        if ended.is_err() || asked.load(Ordering::Relaxed) {
            break;
        }
    }
    if ended.is_err() && evaluation.is_empty() {
        // The corrected command finds no bag in its way.
        args.bag.iter().for_each(|bag| drop(std::fs::remove_dir_all(bag)));
        return ended.map(|()| Ended::Done);
    }
    let summary = Summary { stopped: asked.load(Ordering::Relaxed), ..Summary::new(&reports, []) };
    finish(out, (evaluation, recordings, summary), ended)
}

/// Writes the results, and prints them all the same where that fails. `ended` is how the run ended.
fn finish(
    out: &Path,
    (evaluation, recordings, summary): (Evaluation, Recordings, Summary),
    ended: Result<(), Failure>,
) -> Result<Ended, Failure> {
    let (results, pictured) = (evaluation.results(), recordings.pictured());
    // The files do not wait for a terminal.
    let files = [
        recordings.finish().err().map(|why| anyhow!(why)),
        evaluation.write(out, (&results, pictured), summary.stopped).err().map(anyhow::Error::from),
        summary.write(&out.join(SUMMARY)).err().map(anyhow::Error::from),
    ];
    say_summary(&summary);
    results.iter().for_each(|(stream, result)| print_result(stream, result, &evaluation));
    evaluation.verdicts(&results).iter().for_each(|verdict| say!("{verdict}"));
    if summary.stopped {
        let frames = evaluation.frames();
        note!("[eval] stopped by a signal: the results are those of the {frames} frames before it");
    }
    let ended = ended.err().map(|(Failure::Usage(why) | Failure::Run(why))| why);
    let failures: Vec<_> = ended.into_iter().chain(files.into_iter().flatten()).collect();
    if !failures.is_empty() {
        let all: Vec<_> = failures.iter().map(message_of).collect();
        return Err(anyhow!(all.join("; ")).into());
    }
    tell_slower_engine(&summary);
    if let Some(number) = pictured {
        note!("frame {number} with the boxes of all streams: {}", out.join(GRID).display());
    }
    note!("report: {}", out.join(PAGE).display());
    let lost = summary.lost(false) || summary.stopped || results.values().any(StreamResult::lost);
    Ok(Ended::of(lost))
}

fn print_result(stream: &str, result: &StreamResult, Evaluation { difficulty, .. }: &Evaluation) {
    let score = match result.score() {
        Ok(score) => score,
        Err(why) => return say!("AP50 on {stream}: none, {why}"),
    };
    let classes: Vec<_> = score.classes.iter().map(|(c, (ap, n))| format!("{c} {ap:.3} ({n})")).collect();
    let interval = score.interval95.map_or_else(String::new, |[low, high]| format!(" [{low:.3}, {high:.3}]"));
    say!("AP50 on {stream} ({difficulty} objects): {:.3}{interval}; {}", score.ap50, classes.join(", "));
    score.notes().iter().for_each(|note| say!("  {note}"));
}

/// Opens the recordings, after the checks of the nodes and before the first frame. A refused command leaves none behind.
fn outputs(args: &Eval, out: &Path, plan: &EvaluationPlan) -> Result<Recordings, Failure> {
    let opened = || -> anyhow::Result<Recordings> {
        args.video.iter().try_for_each(|video| prepare_file(video, None))?;
        let video = args.video.as_deref().map(AnnotatedVideo::create).transpose()?;
        let bag = args.bag.as_ref().map(|folder| BagWriter::create(folder, Compression::Zstd)).transpose()?;
        for folder in plan.streams().filter(|_| args.images).map(|stream| out.join(&stream.name)) {
            std::fs::create_dir_all(&folder).map_err(|why| OutputError::new(&folder, why))?;
        }
        Ok(Recordings::new(out, bag, video, args.images))
    };
    opened().map_err(usage)
}

/// Runs the cameras of one source to their ends, or to the first signal.
fn add(
    made: NamedNodes,
    plan: &EvaluationPlan,
    (evaluation, recordings): (&mut Evaluation, &mut Recordings),
    asked: &AtomicBool,
    reports: &mut Vec<NodeReport>,
) -> Result<(), Failure> {
    let names: Vec<&str> = made.iter().map(|(_, node_name)| node_name.name.as_str()).collect();
    note!("[eval] {} in lockstep: every frame once, none dropped", names.join(", "));
    for camera in plan.cameras.iter().filter(|camera| camera.streams.is_empty()) {
        note!("[eval] no detector reads the images of {}", camera.name);
    }
    let timer = SystemClock::default();
    let mut chain = Lockstep::new(&timer, recordings.topics(plan));
    for (node, node_name) in made {
        chain.add(node, &node_name)?;
    }
    let line = ProgressLine::start();
    let ended = evaluation.add(&mut chain, plan, recordings, &|chain| {
        line.show(|| chain.reports());
        if asked.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    reports.extend(chain.finish());
    Ok(ended?)
}

/// Returns the nodes of a launch file; or, to try the sources, its cameras alone.
pub(super) fn nodes(
    file: &Path,
    arguments: &[(String, String)],
    cameras_alone: bool,
) -> Result<NamedNodes, Failure> {
    let plan = modulo_launch::resolve(file, arguments).map_err(usage)?;
    refuse(&plan)?;
    let prepared = evaluable(&plan).map_err(usage)?.into_iter();
    let prepared = prepared.filter(|(.., parameters)| !cameras_alone || parameters.get("source").is_some());
    let make = |(kind, node_name, parameters): (&NodeKind, NodeName, Parameters)| {
        let step = (kind.make)(&parameters).with_context(|| node_name.fully_qualified())?;
        Ok((step, node_name))
    };
    prepared.map(make).collect::<anyhow::Result<_>>().map_err(usage)
}

/// Returns the nodes of a plan with their parameters, if lockstep can run them to an end.
pub(super) fn evaluable(plan: &Plan) -> anyhow::Result<Vec<(&'static NodeKind, NodeName, Parameters)>> {
    let node = |node| {
        let (kind, node_name, parameters) = prepare(node)?;
        if let Some(Value::String(source)) = parameters.get("source") {
            check_source(source, &parameters).with_context(|| node_name.fully_qualified())?;
        }
        Ok((kind, node_name, parameters))
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
