//! `modulo run NODE`: one node in this process, on the wire; and the list of nodes by the name of their executable, the one
//! place that knows all of them.

use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use clap::Args;
use modulo_camera::{CameraParameters, ModuloCamera};
use modulo_detector::{Detector, DetectorParameters};
use modulo_middleware::driver::live::NodeSetup;
use modulo_middleware::driver::{CommonParameters, RunError, live};
use modulo_middleware::graph;
use modulo_middleware::graph::logger::{Logger, LoggerService};
use modulo_middleware::graph::rosout;
use modulo_middleware::graph::rosout::LogQueue;
use modulo_middleware::process::node_files::{ReportFile, SavedState};
use modulo_middleware::process::signals::end_with_launcher;
use modulo_middleware::transport::zenoh::{RawService, ZenohTransport};
use modulo_middleware::transport::{Guard, TransportError};
use modulo_runtime::name::NameError;
use modulo_runtime::ros_args::RosArgs;
use modulo_runtime::wire::keys::SERVICE_QOS;
use modulo_runtime::{
    Descriptor, Node, NodeName, ParameterSet as _, Parameters, SystemClock, Topic, launcher,
};
use modulo_unwrap::{UnwrapNode, UnwrapParameters};
use tracing_subscriber::filter::LevelFilter;

use super::{camera_end, open_session, start_log_with, stop_on_signals, usage};
use crate::{Ended, Failure, LONG_VERSION, VERSION};

#[derive(Args)]
pub struct Run {
    /// Name of the node: modulo_camera, unwrap or detector
    #[arg(allow_hyphen_values = true)]
    pub node: String,
    /// --ros-args ... as ROS 2 writes them, or --help
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    pub arguments: Vec<String>,
}

/// Runs one node until it is done or asked to end.
pub fn run(args: &Run) -> Result<Ended, Failure> {
    if ["-h", "--help"].contains(&args.node.as_str()) {
        say!("{}", crate::cli::help_of("run"));
        return Ok(Ended::Done);
    }
    if args.node == camera_end::NAME {
        return camera_end::run(&args.arguments);
    }
    let kind = kind_of(&args.node).map_err(usage)?;
    let (ros, own) = RosArgs::parse(&args.arguments).map_err(usage)?;
    if answers(kind, &own) {
        return Ok(Ended::Done);
    }
    if let Some(argument) = own.first() {
        return Err(usage(anyhow::anyhow!("{}: '{argument}' is unknown; try --help", kind.name)));
    }
    start(kind, &ros)
}

fn start(kind: &NodeKind, ros: &RosArgs) -> Result<Ended, Failure> {
    let node_name = ros.node_name(kind.name).map_err(usage)?;
    let (log, logger) = start_log(ros, &node_name);
    let stop = stop_on_signals()?;
    // A launcher that was killed cannot tell its nodes to end, so each one watches it by itself.
    end_with_launcher(&stop).context("watch of the launcher")?;

    let settings = ros.parameters_for(&node_name).map_err(usage)?;
    let named = node_name.fully_qualified();
    let refused = |why: anyhow::Error| usage(why.context(named.clone()));
    let parameters = kind.parameters_of(&node_name).map_err(usage)?;
    let settings = parameters.known_of(settings, &named);
    let parameters = parameters.with_text(&settings).map_err(|why| refused(why.into()))?;
    let saved = launcher::folder(launcher::STATE_DIR).map(|folder| SavedState::new(&folder, &node_name));
    let report_file =
        launcher::folder(launcher::REPORT_DIR).map(|folder| ReportFile::create(&folder, &named));
    let report_file = report_file.transpose().context("file of the node's report")?;
    // The node is made before the session is open: it appears in the graph when its model is loaded and it
    // can work.
    let (node, parameters) = restored(kind, parameters, saved.as_ref()).map_err(refused)?;

    let (clock, transport) = open_session()?;
    let CommonParameters { enable_logger_service, .. } = (&parameters).into();
    let _logger = enable_logger_service.then(|| serve(logger, &node_name, &transport)).transpose()?;
    // Dropped before the session, so that the last lines of the log are sent.
    let _rosout = log.map(|log| log.publish(&node_name, &transport)).transpose()?;
    let setup = NodeSetup { node, parameters, node_name, saved, report_file };
    live::run(setup, &transport, &clock, stop).map_err(|why| match why {
        RunError::Name(_) | RunError::OwnOutput(_) | RunError::Parameter(_) => {
            usage(anyhow::anyhow!("{named}: {why}"))
        }
        why => why.into(),
    })?;
    Ok(Ended::Done)
}

/// What a node needs may be away for a moment, such as a network drive: a restart tries so many times, with a pause between, before it
/// takes other parameters.
const TRIES: u32 = 5;
const PAUSE: Duration = Duration::from_millis(250);

/// Makes the node. After a crash it goes on with the parameters that it had accepted, also those that were set at run time. Where
/// these are not possible any more, as with a source that was removed, one of them is that of the launch again, or else all are. Where
/// those are not possible either, all that was kept stays for the next start.
fn restored(
    kind: &NodeKind,
    launched: Parameters,
    saved: Option<&SavedState>,
) -> anyhow::Result<(Box<dyn Node>, Parameters)> {
    let Some(saved) = saved else { return Ok(((kind.make)(&launched)?, launched)) };
    let accepted = saved.restore(launched.clone());
    let mut tries = if accepted == launched { 1 } else { TRIES };
    let why = loop {
        tries -= 1;
        match (kind.make)(&accepted) {
            Ok(node) => return Ok((node, accepted)),
            Err(why) if tries == 0 => break why,
            Err(_) => std::thread::sleep(PAUSE),
        }
    };
    let launched_value = |name: &'static str| Some((name.to_owned(), launched.get(name)?.clone()));
    let names = accepted.descriptors().iter().map(|descriptor| descriptor.name);
    let changed = names.filter(|name| accepted.get(name) != launched.get(name)).filter_map(launched_value);
    let without = changed.filter_map(|value| accepted.with(&[value], false).ok());
    for parameters in without.chain([launched.clone()]).filter(|parameters| *parameters != accepted) {
        let Ok(node) = (kind.make)(&parameters) else { continue };
        tracing::warn!("{why:#}; the node goes on without this value from before the crash");
        // The position counts the frames of a part that is another one now, such as the source.
        if node.prepare(&accepted, &parameters).is_some() {
            saved.forget_position();
        }
        saved.keep(&parameters);
        return Ok((node, parameters));
    }
    Err(why)
}

/// Prints the help or the version where an argument asks for it, and returns whether one did.
fn answers(kind: &NodeKind, own: &[String]) -> bool {
    let asked = |names: [&str; 2]| own.iter().find(|argument| names.contains(&argument.as_str()));
    if asked(["--help", "-h"]).is_some() {
        print_help(kind);
    } else if let Some(argument) = asked(["--version", "-V"]) {
        let version = if argument == "-V" { VERSION } else { LONG_VERSION };
        say!("{} {version}", kind.name);
    } else {
        return false;
    }
    true
}

fn serve(logger: Logger, node_name: &NodeName, transport: &ZenohTransport) -> Result<Guard, TransportError> {
    let logger = Arc::new(logger);
    let services = LoggerService::ALL.iter().map(|&service| {
        let logger = logger.clone();
        RawService::new(service.name_and_type(), SERVICE_QOS, move |request| logger.answer(service, request))
    });
    transport.serve_raw(node_name, services.collect())
}

/// Starts the log; lines for `/rosout` wait in the queue.
fn start_log(ros: &RosArgs, node_name: &NodeName) -> (Option<LogQueue>, Logger) {
    let rosout = || rosout::layer(Arc::new(SystemClock::default()));
    let (layer, queue) = (!ros.no_rosout_logs).then(rosout).unzip();
    let level = ros.log_level_of(&node_name.name);
    let chosen =
        level.is_some() || std::env::var("RUST_LOG").is_ok_and(|directives| directives.contains("modulo"));
    let screen = match ros.no_stdout_logs {
        true => LevelFilter::OFF,
        // The launcher shows the progress of all nodes in place of these lines; `/rosout` has them.
        false if !chosen && launcher::folder(launcher::REPORT_DIR).is_some() => LevelFilter::WARN,
        false => LevelFilter::TRACE,
    };
    let level = level.unwrap_or("info");
    (queue, Logger::new(node_name, level, start_log_with(level, screen, layer)))
}

fn print_help(kind: &NodeKind) {
    say!("{}: {}\n", kind.name, kind.about);
    say!("Usage: modulo run {0} [--ros-args -p NAME:=VALUE ...]\n\nParameters:", kind.name);
    for descriptor in kind.parameters().descriptors() {
        let Descriptor { name, default, allowed, read_only, description } = descriptor;
        let fixed = if *read_only { ", fixed at the start" } else { "" };
        say!("  {name} ({}, {allowed}, default {default}{fixed})\n      {description}", default.type_name());
    }
}

pub struct NodeKind {
    /// Name of the executable, and of the node unless it gets another.
    pub name: &'static str,
    /// A description of one line.
    pub about: &'static str,
    declare: fn() -> Vec<Descriptor>,
    outputs: fn() -> Vec<Topic>,
    pub make: fn(&Parameters) -> anyhow::Result<Box<dyn Node>>,
}

/// All kinds, in the order in which frames pass them.
pub const KINDS: [NodeKind; 3] = [
    NodeKind {
        name: "modulo_camera",
        about: "a simulated modulo sensor over any source of frames",
        declare: CameraParameters::descriptors,
        outputs: modulo_camera::outputs,
        make: |parameters| Ok(Box::new(ModuloCamera::new(&parameters.into())?)),
    },
    NodeKind {
        name: "unwrap",
        about: "modulo image in, recovered image out",
        declare: UnwrapParameters::descriptors,
        outputs: modulo_unwrap::outputs,
        make: |parameters| Ok(Box::new(UnwrapNode::new(&parameters.into())?)),
    },
    NodeKind {
        name: "detector",
        about: "image in, bounding boxes out (YOLO)",
        declare: DetectorParameters::descriptors,
        outputs: modulo_detector::outputs,
        make: |parameters| Ok(Box::new(Detector::new(&parameters.into())?)),
    },
];

/// Returns whether `modulo run` starts a node of this name.
pub fn is_node(name: &str) -> bool {
    name == camera_end::NAME || KINDS.iter().any(|kind| kind.name == name)
}

pub fn kind_of(name: &str) -> anyhow::Result<&'static NodeKind> {
    KINDS.iter().find(|kind| kind.name == name).with_context(|| {
        let known: Vec<_> = KINDS.iter().map(|kind| kind.name).collect();
        format!("node '{name}' is unknown, known are {}", known.join(", "))
    })
}

impl NodeKind {
    /// The parameters of a node of this kind and name with their defaults.
    pub fn parameters_of(&self, node_name: &NodeName) -> Result<Parameters, NameError> {
        let overrides = graph::qos_overrides(node_name, &(self.outputs)())?;
        Ok(Parameters::declare([(self.declare)(), CommonParameters::descriptors(), overrides].concat()))
    }

    /// Its parameters with their defaults, without those that depend on the name of the node.
    pub fn parameters(&self) -> Parameters {
        Parameters::declare([(self.declare)(), CommonParameters::descriptors()].concat())
    }
}

#[cfg(test)]
mod tests {
    use modulo_runtime::Value;

    use super::*;

    /// A source that was away for a moment at a restart cost the parameters that were set at run time, and the position.
    #[test]
    fn what_is_possible_outlasts_a_restart() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let sources = ["a", "b"].map(|name| folder.path().join(name));
        let image = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/streams.png");
        let appear = |source: &std::path::Path| {
            std::fs::create_dir(source).expect("a writable folder");
            std::fs::copy(image, source.join("0.png")).expect("copied");
        };
        sources.iter().for_each(|source| appear(source));
        let (kind, node_name) = (kind_of("modulo_camera").expect("known"), NodeName::default());
        let source =
            |index: usize| ("source".to_owned(), Value::String(sources[index].display().to_string()));
        let launched = kind.parameters().with(&[source(0)], false).expect("possible");
        let saved = SavedState::new(folder.path(), &node_name);
        let restore = || restored(kind, launched.clone(), Some(&saved)).map(|(_, parameters)| parameters);

        let louder = launched.with(&[("alpha".to_owned(), Value::Double(3.0))], true).expect("possible");
        saved.keep(&louder);
        saved.keep_position(7);
        std::fs::remove_dir_all(&sources[0]).expect("removed");
        assert!(restore().is_err());
        appear(&sources[0]);
        assert_eq!((restore().expect("is back"), saved.position()), (louder.clone(), Some(7)));

        saved.keep(&louder.with(&[source(1)], true).expect("possible"));
        std::fs::remove_dir_all(&sources[1]).expect("removed");
        assert_eq!((restore().expect("that of the launch"), saved.position()), (louder.clone(), None));
        assert_eq!(saved.restore(launched.clone()), louder);
    }
}
