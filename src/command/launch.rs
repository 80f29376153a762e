//! `modulo launch FILE`: separate processes, or one with `--compose`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, mpsc};
use std::time::Duration;

use anyhow::{Context, anyhow};
use clap::Args;
use modulo_bags::source::is_rendered;
use modulo_detector::{DEMO, DEMO_LIMIT};
use modulo_launch::plan::{NodeParameter, circle_of};
use modulo_launch::supervisor::{MAX_RESTARTS, ProcessEnd, Watch};
use modulo_launch::{
    Ending, NodePlan, Outcome, Plan, SUMMARY_BEGIN, Summary, Supervision, TRACE_BEGIN, launch_file,
    launch_files, reports_so_far,
};
use modulo_middleware::driver::CommonParameters;
use modulo_middleware::driver::composed::{self, Member};
use modulo_middleware::driver::live::NodeSetup;
use modulo_middleware::process::node_files::ReportFile;
use modulo_middleware::process::signals::end_on_signals;
use modulo_runtime::output::prepare_file;
use modulo_runtime::parameter::file::{self as parameter_file, Entry};
use modulo_runtime::ros_args::RosArgs;
use modulo_runtime::secret::without_secrets;
use modulo_runtime::{Clock, NodeName, NodeReport, Parameters, Stop, SystemClock, Urgency, Value};

use super::colour::say_summary;
use super::eval::evaluable;
use super::progress::ProgressLine;
use super::run::{NodeKind, kind_of};
use super::{completion, domain, pairs, start_log, terminal, usage};
use crate::{Ended, Failure};

/// Time between two looks at the reports of nodes in this process.
const GLANCE: Duration = Duration::from_millis(200);

#[derive(Args)]
pub struct Launch {
    /// Launch file (ROS 2 YAML), or the name of a launch file of the suite, which is found from any folder. Without it, the launch
    /// files that are found are listed
    #[arg(add = completion::files())]
    pub file: Option<PathBuf>,
    /// Arguments as name:=value
    #[arg(add = completion::arguments())]
    pub arguments: Vec<String>,
    /// Run all nodes in this one process
    #[arg(long)]
    pub compose: bool,
    /// Write the summary to this file as JSON
    #[arg(long, value_name = "FILE")]
    pub summary: Option<PathBuf>,
    /// End with exit code 3 also when newer images replaced older ones
    #[arg(long)]
    pub strict: bool,
    /// Replace a node with respawn that shows no sign of life for this time, in seconds; 0 never does
    #[arg(long, value_name = "SECONDS", default_value = "10", value_parser = hang_timeout, conflicts_with = "compose")]
    pub hang_timeout: Duration,
    /// Write a trace of the run to this file, for ui.perfetto.dev or chrome://tracing
    #[arg(long, value_name = "FILE", conflicts_with = "compose")]
    pub trace: Option<PathBuf>,
    /// End the run when a process crashes more often than this within a minute; 0 sets no limit
    #[arg(long, value_name = "PER_MINUTE", default_value_t = MAX_RESTARTS, conflicts_with = "compose")]
    pub max_restarts: u32,
    /// Also print what the nodes log, with one line for each frame
    #[arg(long, short, conflicts_with_all = ["print", "show_args"])]
    pub verbose: bool,
    /// Check the file and print the processes that it would start, or the mistake with its line, and exit
    #[arg(long, conflicts_with_all = ["compose", "summary"])]
    pub print: bool,
    /// Copy a launch file of the suite, and the files that it includes, into the folders launch and sensors below the current folder, where
    /// they can be changed; existing files are kept
    #[arg(long, conflicts_with_all = ["arguments", "compose", "summary", "print", "show_args"])]
    pub copy: bool,
    /// List the file's arguments, and end
    #[arg(long, short = 's', conflicts_with_all = ["compose", "summary", "print"])]
    pub show_args: bool,
}

struct LaunchResult {
    summary: Summary,
    /// The processes that failed, if there are any.
    failure: Option<Failure>,
    /// Whether the run ended by itself.
    completed: bool,
}

/// Starts what the file says and prints the summary at the end.
pub fn launch(args: &Launch) -> Result<Ended, Failure> {
    start_log(if args.verbose { "debug" } else { "warn" });
    let named = args.file.as_deref().ok_or_else(no_file)?;
    let file = &launch_file(named).map_err(usage)?;
    match args {
        Launch { copy: true, .. } => return copy(named),
        Launch { show_args: true, .. } => return show_args(file),
        _ => {}
    }
    let plan = modulo_launch::resolve(file, &pairs(&args.arguments)?).map_err(usage)?;
    refuse(&plan)?;
    if args.print {
        say!("{plan}");
        return Ok(Ended::Done);
    }
    // Each node would refuse a wrong one.
    domain()?;
    warn_of_demo(&known(&plan).map(|(_, parameters)| parameters).collect::<Vec<_>>(), None);
    // A result without a place would be known only when the whole run is over.
    places(args)?;
    // Lockstep runs the nodes as one process does, so the hint at the end is given for such files only.
    let evaluable = evaluable(&plan, false).is_ok();
    let LaunchResult { summary, failure, completed } =
        if args.compose { run_composed(&plan)? } else { run_processes(plan, args)? };
    // The file does not wait for a terminal, nor does a full disk take the printed summary.
    let written = args.summary.as_ref().map(|file| summary.write(file)).transpose();
    // Where a node has refused its arguments, the reason stands alone.
    if !matches!(failure, Some(Failure::Usage(_))) {
        say_summary(&summary);
        tell_slower_engine(&summary);
    }
    written?;
    if evaluable && completed && failure.is_none() && summary.frames > 0 && !summary.detections.is_empty() {
        tell_pictures(named, &args.arguments);
    }
    summary.with_loss.iter().for_each(|why| note!("[launch] {why}"));
    failure.map_or_else(|| Ok(Ended::of(summary.lost(args.strict))), Err)
}

/// Returns the names and the parameters of the nodes of the suite, without those that they ignore.
fn known(plan: &Plan) -> impl Iterator<Item = (NodeName, Parameters)> {
    let known = |node: &NodePlan| {
        let (node_name, declared, mut settings) = settings(node).ok()?;
        settings.retain(|(name, _)| declared.descriptor(name).is_some());
        Some((node_name, declared.with_text(&settings).ok()?))
    };
    plan.nodes.iter().filter(|node| node.package == modulo_launch::SUITE).filter_map(known)
}

/// Warns where the embedded model is to look at anything but rendered scenes: the sources of the cameras among nodes with these
/// `parameters`, or those `read` in their place.
pub(super) fn warn_of_demo(parameters: &[Parameters], read: Option<&[String]>) {
    let texts = |name: &'static str| {
        parameters.iter().filter_map(move |parameters| match parameters.get(name) {
            Some(Value::String(text)) => Some(text),
            _ => None,
        })
    };
    let other = match read {
        Some(sources) => sources.iter().find(|source| !is_rendered(source)),
        None => texts("source").find(|source| !is_rendered(source)),
    };
    if let Some(other) = other.filter(|_| texts("model").any(|model| model == DEMO)) {
        tracing::warn!("{}: {DEMO_LIMIT}, and give model:=yolov10n.onnx", without_secrets(other));
    }
}

/// Takes the places of the summary and the trace.
fn places(args: &Launch) -> Result<(), Failure> {
    let (summary, trace) = (args.summary.as_deref(), args.trace.as_deref());
    summary.map_or(Ok(()), |file| prepare_file(file, Some(SUMMARY_BEGIN))).map_err(usage)?;
    trace.map_or(Ok(()), |file| prepare_file(file, Some(TRACE_BEGIN))).map_err(usage)?;
    let real =
        |file: Option<&Path>| file.and_then(|file| file.canonicalize().ok()).filter(|file| file.is_file());
    match real(summary).filter(|file| real(trace).as_ref() == Some(file)) {
        Some(file) => Err(usage(anyhow!("{}: --summary and --trace need a file each", file.display()))),
        None => Ok(()),
    }
}

/// Prints the command that draws the boxes of this run.
fn tell_pictures(file: &Path, arguments: &[String]) {
    let words = [file.display().to_string()].into_iter().chain(arguments.iter().cloned());
    let words: Vec<String> = words.map(|word| quoted(&word)).collect();
    note!("pictures with boxes: modulo eval {} -o out", words.join(" "));
}

fn hang_timeout(text: &str) -> Result<Duration, String> {
    // Nodes show a sign of life once a second.
    let seconds = text.parse().ok().filter(|seconds| *seconds == 0.0 || (1.0..=3600.0).contains(seconds));
    seconds.map(Duration::from_secs_f64).ok_or_else(|| "must be 0 or a number in 1 to 3600".to_owned())
}

/// Prints how to get the faster engine when a detector did not find it.
pub fn tell_slower_engine(summary: &Summary) {
    if summary.slower_engine {
        note!(
            "hint: rten ran, since no ONNX Runtime library was found; ONNX Runtime is faster, see modulo doctor"
        );
    }
}

/// Quotes `word` for a shell where it needs quotes.
pub(super) fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./:=,+@%".contains(c);
    if word.chars().all(plain) { word.to_owned() } else { format!("'{}'", word.replace('\'', "'\\''")) }
}

/// Refuses a command line without a launch file, and lists the files that can be launched.
fn no_file() -> Failure {
    let files = match launch_files() {
        Ok(files) => files,
        Err(why) => return usage(why),
    };
    // The descriptions begin in one column.
    let width = files.iter().map(|file| file.name.chars().count()).max().unwrap_or(0);
    let lines: String =
        files.iter().map(|file| format!("  {:width$}  {}\n", file.name, file.about)).collect();
    usage(anyhow!(
        "no launch file is given; these were found:\n{lines}\
         Usage: modulo launch FILE [NAME:=VALUE ...]; modulo launch --show-args FILE lists the arguments of a file, and modulo launch \
         --copy FILE makes a copy to be changed"
    ))
}

/// Copies a launch file of the suite into the current folder.
fn copy(named: &Path) -> Result<Ended, Failure> {
    for (path, is_new) in modulo_launch::copy(named, Path::new("")).map_err(usage)? {
        say!("{}{}", path.display(), if is_new { "" } else { " (was there already, and is kept)" });
    }
    Ok(Ended::Done)
}

fn show_args(file: &Path) -> Result<Ended, Failure> {
    for argument in modulo_launch::declared_arguments(file).map_err(usage)? {
        let default = argument.default.map_or("required".to_owned(), |text| format!("default '{text}'"));
        say!("{} ({default})", argument.name);
        if let Some(description) = argument.description {
            say!("    {description}");
        }
        if !argument.choices.is_empty() {
            say!("    one of {}", argument.choices.join(", "));
        }
    }
    Ok(Ended::Done)
}

/// Refuses a plan with a parameter that its node would refuse. Such a node would end its own process, and the reason would be
/// lost in a failed run.
pub(super) fn refuse(plan: &Plan) -> Result<(), Failure> {
    let refused: Vec<String> = plan.nodes.iter().flat_map(refusals).chain(circle(plan)).collect();
    if refused.is_empty() { Ok(()) } else { Err(usage(anyhow!(refused.join("; ")))) }
}

/// Refuses nodes of the suite that wait for each other, or for themselves: they would do so in silence, and then fail.
fn circle(plan: &Plan) -> Option<String> {
    let waits = known(plan).map(|(node_name, parameters)| {
        let CommonParameters { wait_for, .. } = (&parameters).into();
        let others = wait_for.iter().filter_map(|name| node_name.resolve(name).ok());
        (node_name.fully_qualified(), others.collect())
    });
    let waits = waits.collect();
    let circle = circle_of(&waits)?.join(" -> ");
    Some(format!(
        "wait_for goes in a circle ({circle}), so that none of these nodes would ever be ready: take one name out"
    ))
}

/// The parameters of a node that are set, with their values as text, in order.
type SetParameters = Vec<(String, String)>;

/// Returns the kind of a node, its name, its parameters as declared, and those that are set.
fn named(node: &NodePlan) -> anyhow::Result<(&'static NodeKind, NodeName, Parameters, SetParameters)> {
    let kind = kind_of(&node.executable)?;
    let (ros, _) = RosArgs::parse(&modulo_launch::ros_arguments(node))?;
    let node_name = ros.node_name(kind.name)?;
    let (declared, settings) = (kind.parameters_of(&node_name)?, ros.parameters_for(&node_name)?);
    Ok((kind, node_name, declared, settings))
}

/// Returns the name of a node, its parameters as declared, and those that are set, without those that it ignores.
fn settings(node: &NodePlan) -> anyhow::Result<(NodeName, Parameters, SetParameters)> {
    let (_, node_name, declared, settings) = named(node)?;
    let ignored = ignored(node, &node_name, &declared)?;
    let settings = settings.into_iter().filter(|(name, _)| !ignored.contains(name)).collect();
    Ok((node_name, declared, settings))
}

/// Returns the parameters that a node of the suite would refuse, and those that the launch file writes at this node although
/// it has none of that name, each with the reason. A node ignores parameters that are meant for all nodes of a stack.
fn refusals(node: &NodePlan) -> Vec<String> {
    if node.package != modulo_launch::SUITE {
        return Vec::new();
    }
    let (file, line) = &node.declared_at;
    let at = |why: anyhow::Error| format!("{}:{line}: {why:#}", file.display());
    match settings(node) {
        Ok((_, declared, settings)) => {
            // Each setting is tried by itself, so that one refusal does not hide the next one.
            let refused = settings.iter().filter_map(|s| declared.with_text(std::slice::from_ref(s)).err());
            refused.map(|why| at(why.into())).collect()
        }
        Err(why) => vec![at(why)],
    }
}

/// Returns the names that are set for several nodes, unknown to this one, and not written at it: those below a wildcard of a
/// parameter file unless they look like a misspelling.
fn ignored(node: &NodePlan, node_name: &NodeName, declared: &Parameters) -> anyhow::Result<BTreeSet<String>> {
    let unknown = |name: &str| declared.descriptor(name).is_none();
    let (mut ignored, mut written) = (BTreeSet::new(), BTreeSet::new());
    for parameter in &node.parameters {
        match parameter {
            NodeParameter::Value(name, _) => drop(written.insert(name.clone())),
            NodeParameter::File(file) => {
                for Entry { name, by_name, .. } in parameter_file::entries(file, node_name)? {
                    let meant = by_name || declared.near(&name).is_some();
                    if unknown(&name) {
                        if meant { &mut written } else { &mut ignored }.insert(name);
                    }
                }
            }
        }
    }
    Ok(&ignored - &written)
}

fn run_processes(mut plan: Plan, args: &Launch) -> Result<LaunchResult, Failure> {
    for node in plan.nodes.iter_mut().filter(|node| args.verbose && node.package == modulo_launch::SUITE) {
        // In front: a level of the launch file comes later and wins.
        node.ros_args.splice(0..0, ["--log-level", "debug"].map(str::to_owned));
    }
    let names: Vec<&str> = plan.processes().map(|process| process.label.as_str()).collect();
    note!("[launch] starting {}; Ctrl-C ends the run", names.join(", "));
    let line = Arc::new(ProgressLine::start());
    let shown = line.is_shown().then(|| line.clone());
    let watch = shown.map(|line| -> Watch { Arc::new(move |reports| line.show(|| reports.to_vec())) });
    let supervision = Supervision {
        hang_timeout: Some(args.hang_timeout).filter(|limit| !limit.is_zero()),
        max_restarts: Some(args.max_restarts).filter(|most| *most > 0),
        trace: args.trace.clone(),
        ..Supervision::new(Arc::new(terminal::relay), watch)?
    };
    let runtime = tokio::runtime::Runtime::new().context("tokio runtime")?;
    let outcome = runtime.block_on(modulo_launch::run(plan, &supervision))?;
    // The line leaves the screen before the summary is printed.
    drop((supervision, line));
    let mut others = Vec::new();
    match (&args.trace, &outcome.trace) {
        (Some(file), Some(Ok(counts))) => note!("[launch] {}: {counts}", file.display()),
        (_, Some(Err(why))) => others.push(format!("no trace was written: {why}")),
        _ => {}
    }
    let failure = failure_of(&outcome, others);
    Ok(LaunchResult { summary: outcome.summary(), failure, completed: outcome.ending == Ending::Completed })
}

/// Returns the failure of a run in which processes, or those `others`, have failed. A node that has refused its arguments makes
/// it one of the command line.
fn failure_of(outcome: &Outcome, mut others: Vec<String>) -> Option<Failure> {
    let failed: Vec<_> = outcome.processes.iter().filter(|process| process.end.is_failure()).collect();
    let refused =
        others.is_empty() && failed.iter().all(|process| matches!(process.end, ProcessEnd::Refused(_)));
    // All of them are named: the first failure is often the cause of the others.
    let names: Vec<_> = failed.iter().map(|process| format!("{} {}", process.label, process.end)).collect();
    if !names.is_empty() {
        others.insert(0, format!("failed: {}", names.join(", ")));
    }
    let why = anyhow!(others.join("; "));
    (!others.is_empty()).then(|| if refused { usage(why) } else { Failure::Run(why) })
}

fn run_composed(plan: &Plan) -> Result<LaunchResult, Failure> {
    // The end of a member asks `stop`, too; only signals ask `asked`.
    let (stop, asked) = (Stop::default(), Stop::default());
    end_on_signals(&stop).context("signal handlers")?;
    end_on_signals(&asked).context("signal handlers")?;
    let members = members(plan)?;
    let names: Vec<&str> = members.iter().map(|member| member.setup.node_name.name.as_str()).collect();
    note!("[launch] running {} in one process; Ctrl-C ends the run", names.join(", "));
    let reports = run_members(members, &stop)?;
    let completed = asked.urgency() == Urgency::None;
    Ok(LaunchResult { summary: Summary::new(&reports, []), failure: None, completed })
}

/// Runs the members. Where a progress line is shown, they keep their reports in a folder meanwhile.
fn run_members(mut members: Vec<Member>, stop: &Stop) -> Result<Vec<NodeReport>, Failure> {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock::default());
    let line = ProgressLine::start();
    if !line.is_shown() {
        return Ok(composed::run(members, &clock, stop)?);
    }
    let folder = tempfile::tempdir().context("folder of reports")?;
    for member in &mut members {
        let file = ReportFile::create(folder.path(), &member.setup.node_name.fully_qualified());
        member.setup.report_file = Some(file.context("file of a report")?);
    }
    let (end, ended) = mpsc::channel::<()>();
    std::thread::scope(|scope| {
        let (line, folder) = (&line, folder.path());
        scope.spawn(move || {
            while ended.recv_timeout(GLANCE) == Err(mpsc::RecvTimeoutError::Timeout) {
                line.show(|| reports_so_far(folder));
            }
        });
        let reports = composed::run(members, &clock, stop);
        // The closed channel ends the thread at once, without another look at the reports.
        drop(end);
        Ok(reports?)
    })
}

fn members(plan: &Plan) -> Result<Vec<Member>, Failure> {
    let nodes = modulo_launch::compose(plan).map_err(usage)?;
    let member = |node: &NodePlan| {
        let (kind, node_name, parameters) = prepare(node)?;
        let step = (kind.make)(&parameters).with_context(|| node_name.fully_qualified())?;
        let setup = NodeSetup { node: step, parameters, node_name, saved: None, report_file: None };
        Ok(Member { setup, ends_all: node.process.ends_all })
    };
    nodes.iter().map(member).collect::<anyhow::Result<_>>().map_err(usage)
}

/// Returns the kind of a node, its name, and its parameters with the values that the plan sets.
pub fn prepare(node: &NodePlan) -> anyhow::Result<(&'static NodeKind, NodeName, Parameters)> {
    let (kind, node_name, declared, settings) = named(node)?;
    let named = node_name.fully_qualified();
    let known = declared.known_of(settings, &named);
    Ok((kind, node_name, declared.with_text(&known).context(named)?))
}
