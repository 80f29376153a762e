//! `ros2_bridge`: a node in two graphs, that of the suite on zenoh and that of a ROS 2 on DDS.
//!
//! [`plan::BridgePlan`] describes the routes. A node of the suite whose parameters the DDS graph may
//! set appears there under its own name while it is alive ([`mirror`]), with its parameter services and its topics. All
//! other topics belong to the node of the bridge. Messages are forwarded as bytes; none is decoded here, and none goes
//! back to the side that it came from.

mod mirror;
mod plan;
mod topics;

use std::io::{IsTerminal as _, Write as _};
use std::os::unix::process::CommandExt as _;
use std::process::{Command, ExitCode};
use std::sync::Arc;
use std::thread;

use anyhow::Context as _;
use modulo_middleware::process::signals::end_on_signals;
use modulo_middleware::transport::Transport as _;
use modulo_middleware::transport::zenoh::ZenohTransport;
use modulo_runtime::ros_args::RosArgs;
use modulo_runtime::wire::keys::Hashes;
use modulo_runtime::{NodeName, ParameterSet as _, Parameters, Stop, SystemClock, Urgency};
use tracing_subscriber::EnvFilter;

use mirror::Mirror;
use plan::{BridgeParameters, BridgePlan};

/// The variable that keeps the arguments of the command line, and what separates them there.
const ARGUMENTS: &str = "MODULO_BRIDGE_ARGUMENTS";
const SEPARATOR: &str = "\u{1f}";

/// Exit code of a command line that cannot be understood, as in the suite.
const USAGE: u8 = 2;

fn main() -> ExitCode {
    start_log();
    let arguments = match arguments() {
        Ok(arguments) => arguments,
        Err(why) => return fail(ExitCode::FAILURE, &format!("it cannot be started again: {why}")),
    };
    if arguments.iter().any(|argument| argument == "--help" || argument == "-h") {
        let printed = std::io::stdout().write_all(help().as_bytes());
        return if printed.is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE };
    }
    let (plan, node_name) = match plan(&arguments) {
        Ok(planned) => planned,
        Err(why) => return fail(ExitCode::from(USAGE), &format!("{why:#}")),
    };
    match run(&plan, &node_name) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => fail(ExitCode::FAILURE, &format!("{why:#}")),
    }
}

/// Prints the reason of a failure. Where that is not possible, the exit code remains.
fn fail(code: ExitCode, why: &str) -> ExitCode {
    let _ = writeln!(std::io::stderr(), "ros2_bridge: {why}");
    code
}

/// Returns the arguments of the command line, after this process was started again without them. rcl reads the command line
/// by itself and applies a remapping of the node's name, which every launch file gives, to all nodes of the process: the
/// mirrors would have the name of the bridge.
fn arguments() -> std::io::Result<Vec<String>> {
    let given: Vec<String> = std::env::args().skip(1).collect();
    if given.is_empty() {
        let kept = std::env::var(ARGUMENTS).unwrap_or_default();
        return Ok(kept
            .split(SEPARATOR)
            .filter(|argument| !argument.is_empty())
            .map(str::to_owned)
            .collect());
    }
    let mut again = Command::new(std::env::current_exe()?);
    Err(again.env(ARGUMENTS, given.join(SEPARATOR)).exec())
}

/// r2r logs an error each time that a wait ends without a message, which is no fault; what it really cannot do, its
/// functions return.
fn start_log() {
    let filter =
        EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("warn,ros2_bridge=info,r2r=off"));
    let colours =
        std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    // A line that cannot be written, as on a full disk, is dropped; to tell of it, the library would panic.
    log.with_ansi(colours).with_target(false).log_internal_errors(false).init();
}

fn help() -> String {
    let parameter = |descriptor: &modulo_runtime::Descriptor| {
        let (name, kind) = (descriptor.name, descriptor.default.type_name());
        format!("  {name} ({kind})\n      {}\n", descriptor.description)
    };
    let parameters: String = BridgeParameters::descriptors().iter().map(parameter).collect();
    format!(
        "ros2_bridge: topics and parameters between the suite on zenoh and a ROS 2 graph on DDS\n\n\
         Usage: ros2_bridge [--ros-args -p NAME:=VALUE ...]\n\nParameters:\n{parameters}"
    )
}

fn plan(arguments: &[String]) -> anyhow::Result<(BridgePlan, NodeName)> {
    let (ros, own) = RosArgs::parse(arguments)?;
    if let Some(argument) = own.first() {
        anyhow::bail!("'{argument}' is unknown; try --help");
    }
    let node_name = ros.node_name("ros2_bridge")?;
    let declared = Parameters::declare(BridgeParameters::descriptors());
    let settings = declared.known_of(ros.parameters_for(&node_name)?, &node_name.fully_qualified());
    Ok((BridgePlan::new(&BridgeParameters::from_text(&settings)?, &node_name)?, node_name))
}

fn run(plan: &BridgePlan, node_name: &NodeName) -> anyhow::Result<()> {
    // Empty is not set, as in ROS 2.
    let domain = std::env::var("ROS_DOMAIN_ID").ok().filter(|domain| !domain.is_empty());
    let domain = domain.unwrap_or_else(|| "0".to_owned());
    let domain = domain.trim().parse().with_context(|| format!("ROS_DOMAIN_ID = '{domain}'"))?;
    let transport =
        Arc::new(ZenohTransport::open(domain, Hashes::default(), Arc::new(SystemClock::default()))?);
    let dds = r2r::Context::create().context("ROS 2")?;
    let stop = Stop::default();
    end_on_signals(&stop).context("signal handlers")?;
    let names = std::iter::once(None).chain(plan.nodes.iter().map(|node| Some(node.as_str())));
    let mirrors = names.map(|suite_node| Mirror::new(suite_node, plan, node_name, &transport, &dds));
    let mirrors: Vec<Mirror<'_>> = mirrors.collect::<Result<_, _>>()?;
    let _ready = transport.announce(node_name)?;
    // Without one of its nodes the bridge is of no use, so that all end with the first.
    let live = |mirror: &Mirror<'_>| {
        let ended = mirror.run(&stop);
        stop.ask(Urgency::Now);
        ended
    };
    thread::scope(|scope| {
        // A thread for each DDS node: the large images of one do not keep the calls of another waiting.
        let live = &live;
        let threads: Vec<_> = mirrors.iter().map(|mirror| scope.spawn(move || live(mirror))).collect();
        let mut ended =
            threads.into_iter().map(|thread| thread.join().expect("a thread of the bridge does not panic"));
        ended.try_for_each(|ended| ended)
    })
}
