//! `modulo eval`: every frame once through the nodes of a launch file, for each combination of what varies; and the report of it.

use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, anyhow, bail};
use clap::{Args, Subcommand};
use modulo_bags::bag::{BagWriter, Compression};
use modulo_bags::source::{FrameList, SourceError, is_endless};
use modulo_camera::CameraParameters;
use modulo_core::{SensorError, UnwrapError, WorkersError};
use modulo_detector::EngineChoice;
use modulo_eval::data::Data;
use modulo_eval::plan::{PlannedNode, Variant, cameras};
use modulo_eval::progress::{GridEvent, Listener};
use modulo_eval::record::Timelines;
use modulo_eval::recordings::Recordings;
use modulo_eval::results::{Cell, Results};
use modulo_eval::run::{Request, check, run};
use modulo_eval::score::{ScoreOptions, score, words};
use modulo_eval::store::{Folder, figures, save};
use modulo_eval::timing::Timing;
use modulo_eval::variants::{Axes, Resolve, Varied};
use modulo_eval::{GridError, Pictures, below_100, coco, draw_pictures, report};
use modulo_images::ImageError;
use modulo_launch::Plan;
use modulo_middleware::process::signals::first_signal;
use modulo_runtime::clock::utc;
use modulo_runtime::lockstep::Lockstep;
use modulo_runtime::output::ResultFolder;
use modulo_runtime::sensor::options::{CHIP, CodingOptions};
use modulo_runtime::{Clock as _, Parameters, SystemClock, Value};
use modulo_video::VideoAddress;

use super::launch::{prepare, refuse, warn_of_demo};
use super::progress::{FrameProgress, ProgressLine};
use super::run::kind_of;
use super::{completion, images, pairs, start_log, usage};
use crate::{Ended, Failure, message_of};

/// The options of frames that no camera reads.
const LABELLED: [&str; 4] = ["kitti", "sequence", "yolo", "coco"];
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
    /// Values that a launch argument takes by turns, such as alpha=2,4,8, or a parameter of a node, such as unwrap.method=auto,spud
    /// (repeatable: every combination is evaluated)
    #[arg(long, value_name = "NAME=VALUES")]
    pub vary: Vec<Varied>,
    /// Frames to take, by their places from 0 on: FIRST:END, without END
    #[arg(long, value_name = "FIRST:END", value_parser = places)]
    pub frames: Option<Range<usize>>,
    /// Source of frames, such as a bag, a video or scene://PRESET, in place of that of the camera (repeatable: each is a drive)
    #[arg(long, value_name = "SOURCE")]
    pub source: Vec<String>,
    /// The labelled frames.
    #[command(flatten)]
    pub labelled: LabelledFrames,
    /// Folder for the results, which may have some; without it a new one in runs
    #[arg(short, long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    /// Number of frames that are processed in parallel. 0: one for each core
    #[arg(long, default_value_t = 0, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(..=1024))]
    pub jobs: usize,
    /// Remove the results that are in the folder
    #[arg(long)]
    pub fresh: bool,
    /// How the boxes are scored.
    #[command(flatten)]
    pub score: ScoreOptions,
    /// The times to measure.
    #[command(flatten)]
    pub timing: Timing,
    /// What is recorded beside the results.
    #[command(flatten)]
    pub record: Record,
    /// Also print what the nodes log, with one line for each frame
    #[arg(long, short)]
    pub verbose: bool,
    /// Short forms of --vary.
    #[command(flatten)]
    pub short: Short,
}

/// What people look at, from a second run of the nodes with the parameters of the launch file.
#[derive(Args)]
pub struct Record {
    /// New bag folder for the messages on --topics; with FILE
    #[arg(long, value_name = "FOLDER", requires_all = ["topics", "file"], conflicts_with_all = LABELLED)]
    pub bag: Option<PathBuf>,
    /// Topics for --bag
    #[arg(long, value_name = "TOPIC", num_args = 1.., requires = "bag")]
    pub topics: Vec<String>,
    /// Also write every image that a detector gets as PNG, and all streams with their boxes; with FILE
    #[arg(long, requires = "file", conflicts_with_all = LABELLED)]
    pub images: bool,
}

/// Options that stand for values of `--vary`.
#[derive(Args)]
#[command(next_help_heading = "Short forms of --vary")]
pub struct Short {
    /// Parameter file of the camera with the values of the chip and the lens, such as sensors/mosaic.yaml
    #[arg(long, value_name = "FILE", conflicts_with = CHIP)]
    pub sensor: Option<PathBuf>,
    /// What varies.
    #[command(flatten)]
    pub axes: Axes,
    /// Inference engine
    #[arg(long, value_parser = words(EngineChoice::WORDS))]
    pub engine: Option<EngineChoice>,
    /// Device that runs the model: cpu, cuda or tensorrt, the last two with the number of a GPU where it is not the first
    #[arg(long)]
    pub device: Option<String>,
    /// How the samples of the images stand for radiance.
    #[command(flatten)]
    pub coding: CodingOptions,
    /// Seed of the noise
    #[arg(long, allow_negative_numbers = true, value_parser = clap::value_parser!(i64).range(0..))]
    pub seed: Option<i64>,
}

/// Labelled frames in files.
#[derive(Args)]
pub struct LabelledFrames {
    /// KITTI object folder (image_2, label_2)
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["sequence", "yolo", "coco", "source"])]
    pub kitti: Option<PathBuf>,
    /// Frames of --kitti to take: a file of lines FRAME [DRIVE]
    #[arg(long, value_name = "FILE", requires = "kitti")]
    pub list: Option<PathBuf>,
    /// KITTI drives with tracking labels, one folder for each drive
    #[arg(long, value_name = "FOLDER", num_args = 1.., conflicts_with_all = ["yolo", "coco", "source"])]
    pub sequence: Vec<PathBuf>,
    /// Images with YOLO labels: a folder (subfolders images and labels, or both side by side), the data.yaml of a data set, of which val is
    /// taken, or a list of images (.txt)
    #[arg(long, value_name = "PATH", conflicts_with_all = ["coco", "source"])]
    pub yolo: Option<PathBuf>,
    /// COCO annotation file
    #[arg(long, value_name = "JSON", conflicts_with = "source")]
    pub coco: Option<PathBuf>,
    /// Folder of the images of --coco, if they are not in the usual place
    #[arg(long, value_name = "FOLDER", requires = "coco")]
    pub coco_images: Option<PathBuf>,
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

/// Reads `FIRST:END`.
fn places(text: &str) -> Result<Range<usize>, String> {
    let parsed = text.split_once(':').and_then(|(first, end)| {
        let first = if first.is_empty() { 0 } else { first.parse().ok()? };
        let end = if end.is_empty() { usize::MAX } else { end.parse().ok()? };
        (first < end).then_some(first..end)
    });
    parsed.ok_or_else(|| "must be FIRST:END with FIRST below END, such as 0:250".to_owned())
}

pub fn eval(args: &Eval) -> Result<Ended, Failure> {
    start_log(if args.verbose { "debug" } else { "warn" });
    match &args.verb {
        Some(Verb::Report { folders, score, coco }) => return show(folders, score, coco.as_deref()),
        Some(Verb::Stability { out }) => return images::stability(out.as_deref()),
        None => {}
    }
    let file = args.file.clone().unwrap_or_else(|| PathBuf::from(COMPARE));
    let file = modulo_launch::launch_file(&file).map_err(usage)?;
    let arguments = pairs(&args.arguments)?;
    let data = args.labelled.data(&args.source)?;
    if args.file.is_none() && data.is_none() {
        return Err(usage(anyhow!(
            "nothing to evaluate: give a launch file, or one of --kitti, --sequence, --yolo, --coco, --source"
        )));
    }
    let has_frames = data.is_some();
    let nodes = |more: &[(String, String)]| {
        let planned = planned(&file, &[&arguments[..], more].concat(), has_frames);
        planned.map_err(|(Failure::Usage(why) | Failure::Run(why))| GridError::Request(message_of(&why)))
    };
    let variants = args.variants(&nodes)?;
    let out = Folder::take(args.out.as_deref()).map_err(failure)?;
    let request = args.request(variants, data, out.path())?;
    // What cannot be evaluated leaves no recording behind.
    check(&request).map_err(failure)?;
    tell_demo(&request.variants, request.data.as_ref());
    let mut recordings = args.record.open(&request.variants, out.path())?;
    let asked = first_signal().context("signal handlers")?;
    let timer = SystemClock::default();
    let stopped = || asked.load(Ordering::Relaxed);
    let results = with_progress(|tell| run(&request, &timer, &Listener { tell, stopped: &stopped }))?;
    recordings.iter_mut().try_for_each(|recordings| args.record(recordings, &nodes, &asked))?;
    if !stopped() {
        picture(&request, &results)?;
    }
    finish(&results, &write(out.path(), &results)?, stopped())
}

/// Warns where the embedded model is to look at other frames than rendered ones.
fn tell_demo(variants: &[Variant], data: Option<&Data>) {
    let read = data.map(|data| match data {
        Data::Any(sources) => sources.clone(),
        _ => vec!["the labelled frames".to_owned()],
    });
    let parameters = variants.iter().flat_map(|variant| &variant.nodes).map(|node| node.parameters.clone());
    warn_of_demo(&parameters.collect::<Vec<_>>(), read.as_deref());
}

/// Draws the frame in which the streams differ most.
fn picture(request: &Request, results: &Results) -> Result<(), Failure> {
    let drawn = draw_pictures(request, &SystemClock::default(), results).map_err(failure)?;
    if let Some(Pictures { title, sheet }) = drawn {
        report::save_pictures(&request.out, &sheet).map_err(failure)?;
        let file = request.out.join(report::GRID);
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

impl Eval {
    fn request(&self, variants: Vec<Variant>, data: Option<Data>, out: &Path) -> Result<Request, Failure> {
        let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_else(|_| "unknown".into());
        let started = utc(SystemClock::default().now_ns() / 1_000_000_000);
        let pass = format!("{} {}Z", host.trim(), started.replace(' ', "T"));
        Ok(Request {
            variants,
            data,
            places: self.frames.clone().unwrap_or(0..usize::MAX),
            jobs: self.jobs,
            timing: Timing { pass, processor: processor(), ..self.timing.clone() },
            score: self.score.clone(),
            fresh: self.fresh,
            out: out.to_owned(),
        })
    }

    /// The nodes of each combination of what varies.
    fn variants(&self, nodes: &Resolve<'_>) -> Result<Vec<Variant>, Failure> {
        let Short { sensor, axes, engine, device, coding, seed } = &self.short;
        let mut axes = axes.clone();
        if let Some(file) = sensor {
            axes.sensor.take_chip(&CameraParameters::read_sensor(file).map_err(usage)?);
        }
        let CodingOptions { white, black, knees } = coding;
        let given = [
            ("detector.engine", engine.map(|engine| engine.word().to_owned())),
            ("detector.device", device.clone()),
            ("modulo_camera.seed", seed.map(|seed| seed.to_string())),
            ("modulo_camera.white", (*white != 0.0).then(|| white.to_string())),
            ("modulo_camera.black", (*black != 0.0).then(|| black.to_string())),
            ("modulo_camera.knees", knees.as_ref().map(ToString::to_string)),
        ];
        let given = given.into_iter().filter_map(|(name, value)| Some(Varied::one(name, value?)));
        let varied: Vec<Varied> = given.chain(self.vary.iter().cloned()).collect();
        axes.variants(nodes, &varied, self.file.is_none()).map_err(failure)
    }

    /// Runs the nodes for `recordings`, source after source.
    fn record(
        &self,
        recordings: &mut Recordings,
        nodes: &Resolve<'_>,
        asked: &AtomicBool,
    ) -> Result<(), Failure> {
        let of_source = |source: &String| vec![("source".to_owned(), source.clone())];
        let mut runs: Vec<_> = self.source.iter().map(of_source).collect();
        if runs.is_empty() {
            runs.push(Vec::new());
        }
        let (timer, mut timelines) = (SystemClock::default(), Timelines::default());
        for run in runs {
            let planned = nodes(&run).map_err(failure)?;
            let cameras = cameras(&planned, &self.record.topics).map_err(failure)?;
            let mut chain = Lockstep::new(&timer, recordings.topics(&cameras));
            add(planned, &mut chain)?;
            let line = ProgressLine::start();
            timelines.record(&mut chain, &cameras, recordings, &|chain| {
                line.show(|| chain.reports());
                if asked.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            })?;
        }
        std::mem::take(recordings).finish().map_err(|why| anyhow!(why).into())
    }
}

impl Record {
    /// Opens what is recorded, after the checks of the nodes and before the first frame. A refused command leaves none behind.
    fn open(&self, variants: &[Variant], out: &Path) -> Result<Option<Recordings>, Failure> {
        cameras(&variants[0].nodes, &self.topics).map_err(failure)?;
        let opened = || -> anyhow::Result<Recordings> {
            let bag =
                self.bag.as_ref().map(|folder| BagWriter::create(folder, Compression::Zstd)).transpose()?;
            Ok(Recordings::new(out, bag.map(|bag| (bag, self.topics.clone())), self.images))
        };
        let recordings = opened().map_err(usage)?;
        if variants.len() > 1 && !recordings.is_empty() {
            let why = "--bag and --images record one variant; give each argument one value";
            return Err(usage(anyhow!(why)));
        }
        Ok(Some(recordings).filter(|recordings| !recordings.is_empty()))
    }
}

impl LabelledFrames {
    /// Returns the frames that these options and `source` name; `None` for those of the cameras.
    fn data(&self, source: &[String]) -> Result<Option<Data>, Failure> {
        let list = self.list.as_deref().map(FrameList::read).transpose()?;
        Ok(match (&self.kitti, &self.sequence[..], &self.yolo, &self.coco, source) {
            (Some(folder), ..) => Some(Data::Kitti { folder: folder.clone(), list }),
            (None, [_, ..], ..) => Some(Data::Sequences(self.sequence.clone())),
            (None, [], Some(folder), ..) => Some(Data::Yolo(folder.clone())),
            (None, [], None, Some(annotations), _) => {
                Some(Data::Coco { annotations: annotations.clone(), images: self.coco_images.clone() })
            }
            (None, [], None, None, [_, ..]) => match source.iter().find(|source| is_endless(source)) {
                Some(endless) => {
                    let why =
                        "has no end, but an evaluation needs one; give the number of frames as well, such as";
                    return Err(usage(anyhow!("--source {endless} {why} scene://day?frames=60")));
                }
                None => Some(Data::Any(source.to_vec())),
            },
            _ => None,
        })
    }
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

/// The model of the processor from `/proc/cpuinfo`, or its architecture.
fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    match model {
        Some((_, name)) => name.split_whitespace().collect::<Vec<_>>().join(" "),
        None => std::env::consts::ARCH.to_owned(),
    }
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

/// Makes the nodes and adds them to a chain.
fn add(planned: Vec<PlannedNode>, chain: &mut Lockstep<'_>) -> Result<(), Failure> {
    for PlannedNode { executable, name, parameters } in planned {
        let made = (kind_of(executable)?.make)(&parameters);
        chain.add(made.with_context(|| name.fully_qualified()).map_err(usage)?, &name)?;
    }
    Ok(())
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
