//! `ros2_bridge`: a node in two graphs, that of the suite on zenoh and that of a ROS 2 on DDS.
//!
//! [`modulo_runtime::bridge::BridgePlan`] describes the routes. A node of the suite whose parameters the DDS graph may
//! set appears there under its own name while it is alive ([`mirror`]), with its parameter services and its topics. All
//! other topics belong to the node of the bridge. Messages are forwarded as bytes; none is decoded here, and none goes
//! back to the side that it came from.

mod mirror;
mod parameters;
mod topics;

use std::io::IsTerminal as _;
use std::process::ExitCode;
use std::sync::Arc;
use std::thread;

use anyhow::Context as _;
use modulo_runtime::bridge::{BridgeParameters, BridgePlan};
use modulo_runtime::ros_args::RosArgs;
use modulo_runtime::transport::Transport as _;
use modulo_runtime::transport::keys::Hashes;
use modulo_runtime::transport::zenoh::ZenohTransport;
use modulo_runtime::{NodeName, ParameterSet as _, Stop, SystemClock, Urgency, end_on_signals};
use tracing_subscriber::EnvFilter;

use mirror::Mirror;

/// Exit code of a command line that cannot be understood, as in the suite.
const USAGE: u8 = 2;

fn main() -> ExitCode {
    start_log();
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments.iter().any(|argument| argument == "--help" || argument == "-h") {
        print_help();
        return ExitCode::SUCCESS;
    }
    let (plan, node_name) = match plan(&arguments) {
        Ok(planned) => planned,
        Err(why) => {
            eprintln!("ros2_bridge: {why:#}");
            return ExitCode::from(USAGE);
        }
    };
    match run(&plan, &node_name) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("ros2_bridge: {why:#}");
            ExitCode::FAILURE
        }
    }
}

/// r2r logs an error each time that a wait ends without a message, which is no fault; what it really cannot do, its
/// functions return.
fn start_log() {
    let filter =
        EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("warn,ros2_bridge=info,r2r=off"));
    let colours =
        std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    log.with_ansi(colours).with_target(false).init();
}

fn print_help() {
    println!("ros2_bridge: topics and parameters between the suite on zenoh and a ROS 2 graph on DDS\n");
    println!("Usage: ros2_bridge [--ros-args -p NAME:=VALUE ...]\n\nParameters:");
    for descriptor in BridgeParameters::descriptors() {
        println!(
            "  {} ({})\n      {}",
            descriptor.name,
            descriptor.default.type_name(),
            descriptor.description
        );
    }
}

fn plan(arguments: &[String]) -> anyhow::Result<(BridgePlan, NodeName)> {
    let (ros, own) = RosArgs::parse(arguments)?;
    if let Some(argument) = own.first() {
        anyhow::bail!("'{argument}' is unknown; try --help");
    }
    let node_name = ros.node_name("ros2_bridge")?;
    let settings = ros.parameters_for(&node_name)?;
    Ok((BridgePlan::new(&BridgeParameters::from_text(&settings)?, &node_name)?, node_name))
}

fn run(plan: &BridgePlan, node_name: &NodeName) -> anyhow::Result<()> {
    let domain = std::env::var("ROS_DOMAIN_ID").unwrap_or_else(|_| "0".to_owned());
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
    thread::scope(|scope| {
        // A thread for each DDS node: the large images of one do not keep the calls of another waiting.
        let threads: Vec<_> = mirrors.iter().map(|mirror| scope.spawn(|| mirror.run(&stop))).collect();
        threads.into_iter().try_for_each(|thread| {
            let ended = thread.join().expect("a thread of the bridge does not panic");
            // Without one of its nodes the bridge is of no use.
            stop.ask(Urgency::Now);
            ended
        })
    })
}
