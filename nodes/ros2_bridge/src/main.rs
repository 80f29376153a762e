//! `ros2_bridge`: a node in two graphs, that of the suite on zenoh and that of a
//! ROS 2 on DDS. It forwards topics as bytes and calls of the parameter services.
//!
//! `modulo_runtime::bridge::BridgePlan` describes the routes. No message is decoded here, and none goes back to the side that it came from.

mod parameters;
mod topics;

use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use modulo_runtime::bridge::{BridgeParameters, BridgePlan};
use modulo_runtime::end_on_signals;
use modulo_runtime::ros_args::RosArgs;
use modulo_runtime::transport::Transport as _;
use modulo_runtime::transport::keys::Hashes;
use modulo_runtime::transport::zenoh::ZenohTransport;
use modulo_runtime::{ParameterSet as _, Stop, SystemClock, Urgency};

/// Time of one look for messages of the DDS graph.
const GLANCE: Duration = Duration::from_millis(10);

fn main() -> anyhow::Result<()> {
    tracing_subscriber::fmt().with_writer(std::io::stderr).with_target(false).init();
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (ros, _) = RosArgs::parse(&arguments)?;
    let node_name = ros.node_name("ros2_bridge")?;
    let settings = ros.parameters_for(&node_name)?;
    let plan = BridgePlan::new(&BridgeParameters::from_text(&settings)?, &node_name)?;

    let domain = std::env::var("ROS_DOMAIN_ID").unwrap_or_else(|_| "0".to_owned());
    let domain = domain.trim().parse().with_context(|| format!("ROS_DOMAIN_ID = '{domain}'"))?;
    let clock = Arc::new(SystemClock::default());
    let transport = Arc::new(ZenohTransport::open(domain, Hashes::default(), clock)?);
    let dds = r2r::Context::create().context("ROS 2")?;
    let mut node = r2r::Node::create(dds, &node_name.name, &node_name.namespace).context("ROS 2 node")?;

    let stop = Stop::default();
    end_on_signals(&stop).context("signal handlers")?;
    let mut wires = Vec::new();
    for route in &plan.routes {
        wires.push(topics::forward(route, &node_name, &transport, &mut node)?);
        tracing::info!("{} ({}): {:?}", route.topic, route.ros_type, route.direction);
    }
    for suite_node in &plan.nodes {
        parameters::offer(suite_node, &transport, &mut node)?;
        tracing::info!("parameters of {suite_node}");
    }
    let _ready = transport.announce(&node_name)?;
    while stop.urgency() == Urgency::None {
        node.spin_once(GLANCE);
    }
    Ok(())
}
