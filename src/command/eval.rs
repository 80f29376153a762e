//! `modulo eval FILE`: runs the nodes of a launch file in lockstep. Without FILE it runs the grid.

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};
use clap::{Args, Subcommand};
use modulo_bags::bag::{BagWriter, Compression};
use modulo_bags::source::SourceError;
use modulo_eval::launch_file::{DetectorStream, Evaluation, EvaluationPlan, Recordings, StreamScore};
use modulo_eval::store;
use modulo_eval::video::AnnotatedVideo;
use modulo_launch::Summary;
use modulo_runtime::lockstep::Lockstep;
use modulo_runtime::topic::RECOVERY_TOPIC;
use modulo_runtime::{MessageKind, Node, NodeName, NodeReport, SystemClock, Value};
use modulo_video::{VideoAddress, VideoError};

use super::launch::{prepare, refuse, tell_slower_engine};
use super::progress::ProgressLine;
use super::{grid, pairs, start_log, usage};
use crate::{Ended, Failure};

/// `modulo eval`
#[derive(Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Eval {
    /// Command for existing results
    #[command(subcommand)]
    pub verb: Option<Verb>,
    /// Launch file (ROS 2 YAML) with one camera. Without it: a grid over --kitti, --sequence, --yolo, --coco or
    /// --source
    #[arg(conflicts_with = "LabelledFrames")]
    pub file: Option<PathBuf>,
    /// Arguments of the launch file as name:=value
    #[arg(requires = "file")]
    pub arguments: Vec<String>,
    /// Source of frames, such as a bag, a video or scene://PRESET: for the grid, or instead of the source in FILE (repeatable)
    #[arg(long, value_name = "SOURCE")]
    pub source: Vec<String>,
    /// Folder for the results
    #[arg(short, long, value_name = "FOLDER", required = true)]
    pub out: Option<PathBuf>,
    /// With FILE: write the messages on --topics into this new bag folder
    #[arg(long, value_name = "FOLDER", requires_all = ["topics", "file"])]
    pub bag: Option<PathBuf>,
    /// Topics for --bag
    #[arg(long, value_name = "TOPIC", num_args = 1.., requires = "bag")]
    pub topics: Vec<String>,
    /// With FILE: write every image that a detector gets as PNG
    #[arg(long, requires = "file")]
    pub images: bool,
    /// With FILE: write the boxes of all detectors, with the method and the trust of each frame, into this video, such as out.mp4
    /// (needs ffmpeg)
    #[arg(long, value_name = "VIDEO", requires = "file")]
    pub video: Option<PathBuf>,
    /// Also print what the nodes log, with one line for each frame
    #[arg(long, short)]
    pub verbose: bool,
    #[command(flatten)]
    pub grid: grid::Grid,
}

/// `modulo eval VERB`
#[derive(Subcommand)]
pub enum Verb {
    /// Join the results of shards
    Merge {
        /// Folder for the joined results
        out: PathBuf,
        /// Folders of the shards
        #[arg(required = true)]
        folders: Vec<PathBuf>,
    },
    /// Draw charts and report of the results in a folder again
    Report {
        /// Folder with results.json
        folder: PathBuf,
    },
    /// Print the stream, method and model of highest accuracy within a time
    Budget {
        /// Folder with results.json
        folder: PathBuf,
        /// Time from the captured image to the boxes, ms
        #[arg(long)]
        ms: f64,
    },
}

/// Runs the evaluation or the subcommand.
pub fn eval(args: &Eval) -> Result<Ended, Failure> {
    start_log(if args.verbose { "debug" } else { "warn" });
    match &args.verb {
        Some(Verb::Merge { out, folders }) => return grid::merge(out, folders),
        Some(Verb::Report { folder }) => return grid::report(folder),
        Some(Verb::Budget { folder, ms }) => return grid::budget(folder, *ms),
        None => {}
    }
    let out = args.out.as_deref().context("--out is needed").map_err(usage)?;
    match &args.file {
        Some(file) => launch_file(args, &modulo_launch::launch_file(file), out),
        None => grid::grid(&args.grid, &args.source, out),
    }
}

/// Runs every frame of the camera of the file, or of each `--source`, through the nodes, and writes boxes and scores.
fn launch_file(args: &Eval, file: &Path, out: &Path) -> Result<Ended, Failure> {
    let arguments = pairs(&args.arguments)?;
    let mut evaluation = Evaluation::new(args.grid.options.difficulty.unwrap_or_default());
    let bag = args.bag.as_ref().map(|folder| BagWriter::create(folder, Compression::Zstd)).transpose()?;
    if let (Some(video), Err(why)) = (&args.video, modulo_video::version()) {
        return Err(usage(VideoError::NoProgram(video.display().to_string(), why)));
    }
    let video = args.video.as_deref().map(AnnotatedVideo::create).transpose().map_err(usage)?;
    let mut recordings = Recordings { bag, video };
    let mut reports = Vec::new();
    if args.source.is_empty() {
        reports = run(args, (file, out), &arguments, &mut evaluation, &mut recordings)?;
    }
    // All sources add to the same evaluation, so that the scores count over all frames and not over sources.
    for source in &args.source {
        let arguments = [arguments.clone(), vec![("source".to_owned(), source.clone())]].concat();
        reports.extend(run(args, (file, out), &arguments, &mut evaluation, &mut recordings)?);
    }
    recordings.bag.map(BagWriter::finish).transpose()?;
    recordings.video.map(AnnotatedVideo::finish).transpose()?;
    evaluation.write(out)?;
    let summary = Summary::new(&reports, []);
    summary.write(&out.join("summary.json"))?;
    say!("{}", summary.to_string().trim_end());
    evaluation.scores().iter().for_each(|(stream, score)| print_score(stream, score));
    tell_slower_engine(&summary);
    if args.images {
        eprintln!("pictures with boxes: {}", out.join("grid.png").display());
    } else {
        eprintln!("pictures with boxes: the same command with --images");
    }
    Ok(if summary.lost(false) { Ended::WithLoss } else { Ended::Done })
}

fn print_score(stream: &str, score: &StreamScore) {
    let classes: Vec<_> = score.classes.iter().map(|(c, (ap, n))| format!("{c} {ap:.3} ({n})")).collect();
    say!("AP50 on {stream} ({} objects): {:.3}; {}", score.difficulty, score.ap50, classes.join(", "));
}

fn run(
    args: &Eval,
    (file, out): (&Path, &Path),
    arguments: &[(String, String)],
    evaluation: &mut Evaluation,
    recordings: &mut Recordings,
) -> Result<Vec<NodeReport>, Failure> {
    let made = nodes(file, arguments)?;
    // A node that asks for a period is driven by time and not by messages: it is where frames come from.
    let source = made.iter().position(|(node, _)| node.period().is_some());
    let source = source.with_context(|| format!("{}: no node is a source of frames", file.display()));
    let source = source.map_err(usage)?;
    let plan = EvaluationPlan {
        interval: made[source].0.period().expect("the source was found by its period"),
        streams: streams(&made)?,
        truth: topic_of(&made[source].0.outputs(), MessageKind::Detections, &made[source].1)?,
        save_images: args.images,
        folder: out.to_owned(),
        bagged: args.topics.clone(),
    };
    let mut recorded: Vec<String> = plan.streams.iter().map(|s| s.detections.clone()).collect();
    recorded.extend(plan.truth.iter().chain(&plan.bagged).cloned());
    if plan.save_images {
        recorded.extend(plan.streams.iter().map(|s| s.images.clone()));
    }
    if plan.save_images || recordings.video.is_some() {
        recorded.extend(plan.streams.iter().filter_map(|s| s.annotated.clone()));
    }
    if recordings.video.is_some() {
        recorded.extend(plan.streams.iter().filter_map(|s| s.recovery.clone()));
    }
    // After the checks of the nodes, so that a wrong command makes no folder, and before the first frame.
    store::prepare(out).map_err(grid::failure)?;
    let names: Vec<&str> = made.iter().map(|(_, node_name)| node_name.name.as_str()).collect();
    eprintln!("[eval] {} in lockstep: every frame once, none dropped", names.join(", "));
    let timer = SystemClock::default();
    let mut chain = Lockstep::new(&timer, recorded);
    for (node, node_name) in made {
        chain.add(node, &node_name)?;
    }
    let line = ProgressLine::start();
    evaluation.add(&mut chain, source, &plan, recordings, &|chain| line.show(|| chain.reports()))?;
    Ok(chain.finish())
}

type Made = Vec<(Box<dyn Node>, NodeName)>;

fn nodes(file: &Path, arguments: &[(String, String)]) -> Result<Made, Failure> {
    let plan = modulo_launch::resolve(file, arguments).map_err(usage)?;
    refuse(&plan)?;
    let nodes = modulo_launch::compose(&plan).map_err(usage)?;
    let make = |node| {
        let (kind, node_name, parameters) = prepare(node)?;
        if let Some(Value::String(source)) = parameters.get("source")
            && let Some(VideoAddress::Live(address)) = VideoAddress::of(source)?
        {
            bail!(SourceError::Live(address));
        }
        let step = kind.make(&parameters).with_context(|| node_name.fully_qualified())?;
        Ok((step, node_name))
    };
    nodes.iter().map(make).collect::<anyhow::Result<_>>().map_err(usage)
}

/// The topics of every node that turns images into boxes.
fn streams(made: &Made) -> Result<Vec<DetectorStream>, Failure> {
    let mut streams = Vec::new();
    for (node, node_name) in made {
        let images = topic_of(&node.inputs(), MessageKind::Image, node_name)?;
        let boxes = topic_of(&node.outputs(), MessageKind::Detections, node_name)?;
        let annotated = topic_of(&node.outputs(), MessageKind::Image, node_name)?;
        if let (Some(images), Some(boxes)) = (images, boxes) {
            let recovery = recovery_of(&images, made)?;
            streams.push(DetectorStream { recovery, ..DetectorStream::new(images, boxes, annotated) });
        }
    }
    if streams.is_empty() {
        return Err(usage(anyhow!("no node of the launch file turns images into boxes")));
    }
    Ok(streams)
}

/// The topic on which the node that makes `images` says how it has unwrapped each of them, if one does.
fn recovery_of(images: &str, made: &Made) -> Result<Option<String>, Failure> {
    for (node, node_name) in made {
        let outputs = node.outputs();
        let Some(recovery) = outputs.iter().find(|topic| topic.name == RECOVERY_TOPIC) else { continue };
        for output in outputs.iter().filter(|topic| topic.kind == MessageKind::Image) {
            if node_name.resolve(&output.name)? == images {
                return Ok(Some(node_name.resolve(&recovery.name)?));
            }
        }
    }
    Ok(None)
}

fn topic_of(
    topics: &[modulo_runtime::Topic],
    kind: MessageKind,
    node_name: &NodeName,
) -> Result<Option<String>, Failure> {
    let topic = topics.iter().find(|topic| topic.kind == kind);
    Ok(topic.map(|topic| node_name.resolve(&topic.name)).transpose()?)
}
