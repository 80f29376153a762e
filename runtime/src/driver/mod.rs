//! The three drivers of a step: `live` (one node on a transport, the newest frame wins), `composed` (several live nodes
//! in one process, on the local transport) and `lockstep` (every frame once, in order, nothing dropped).

pub mod composed;
pub mod live;
pub mod lockstep;
pub mod pacing;

use std::time::Duration;

use modulo_images::FileFormat;

use crate::clock::{Clock, nanos};
use crate::graph::{NameError, NodeName, Topic};
use crate::message::MessageKind;
use crate::node::{Node, Trigger};
use crate::parameter::{ParameterError, Parameters};
use crate::process::stop::{Stop, Urgency};
use crate::transport::{Address, Transport, TransportError};

/// Time between two looks at the graph while a change in it is awaited.
const GRAPH_GLANCE: Duration = Duration::from_millis(20);

/// Error: a driver ended before its node was done.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RunError {
    /// The name of a topic or node is not valid.
    #[error(transparent)]
    Name(#[from] NameError),
    /// The transport failed.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// A parameter was refused at the start.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// An input of the node is one of its own outputs.
    #[error("this node publishes {0} itself, and would answer its own images; name a topic of another node")]
    OwnOutput(String),
    /// The step cannot go on.
    #[error("{0}: {1}")]
    Fatal(String, String),
    /// A node that this one waits for did not come.
    #[error("{node}: waited {seconds} s for {missing}, which is not there; start it, or change wait_for")]
    Waited {
        /// The node that waited.
        node: String,
        /// Time of the wait in seconds.
        seconds: u64,
        /// Names of the nodes that are missing.
        missing: String,
    },
}

/// The variant of image topics that a node reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageTransport {
    /// `sensor_msgs/msg/Image`
    Raw,
    /// `sensor_msgs/msg/CompressedImage`
    Compressed,
}

crate::parameters! {
    /// The parameters that the driver itself reads, for every node.
    pub struct CommonParameters {
        /// Takes stamps from the topic /clock instead of the machine's clock. The time is 0 before the first message on
        /// /clock.
        use_sim_time: bool = false,
        /// Names of the nodes that must be ready before this node reports ready or sends its first frame.
        wait_for: Vec<String> = Vec::new(); fixed,
        /// Time in seconds to wait for the nodes of wait_for. The node fails when they are not ready by then.
        wait_timeout: f64 = 60.0 => 0.0..=3600.0; fixed,
        /// Variant of the image topics that this node reads: raw (NAME), or compressed (NAME/compressed, a
        /// CompressedImage). Of modulo images only PNG is read.
        image_transport: ImageTransport = ImageTransport::Raw
            => [("raw", ImageTransport::Raw), ("compressed", ImageTransport::Compressed)],
        /// File format of the topics NAME/compressed, which are published for each image topic NAME while they have a
        /// reader. Modulo images and images of more than 8 bits are always png.
        compressed_format: FileFormat = FileFormat::Jpeg => FileFormat::WORDS,
        /// Offers the services ~/get_logger_levels and ~/set_logger_levels, which read and change the level of the log.
        enable_logger_service: bool = false; fixed,
    }
}

fn wait_for(node_name: &NodeName, parameters: &Parameters) -> Result<(Vec<String>, Duration), NameError> {
    let CommonParameters { wait_for, wait_timeout, .. } = parameters.into();
    let names = wait_for.iter().map(|name| node_name.resolve(name)).collect::<Result<_, _>>()?;
    Ok((names, Duration::from_secs_f64(wait_timeout)))
}

/// Waits until all `nodes` (fully qualified names) are ready, or until `stop` asks for an end.
///
/// # Errors
/// The names of the missing nodes when they are not ready within `patience`.
pub fn wait_until_ready(
    transport: &dyn Transport,
    clock: &dyn Clock,
    mut nodes: Vec<String>,
    patience: Duration,
    stop: &Stop,
) -> Result<(), String> {
    let start = clock.ticks_ns();
    loop {
        // A node that was ready once is not asked for again: it may have done its work and ended.
        nodes.retain(|node| !transport.is_ready(node));
        if nodes.is_empty() || stop.urgency() != Urgency::None {
            return Ok(());
        }
        if clock.ticks_ns().saturating_sub(start) > nanos(patience) {
            return Err(nodes.join(", "));
        }
        std::thread::sleep(GRAPH_GLANCE);
    }
}

fn addresses(node_name: &NodeName, topics: &[Topic]) -> Result<Vec<Address>, NameError> {
    topics.iter().map(|topic| Address::resolve(node_name, topic)).collect()
}

/// Returns the name of the stream that the message of `trigger` came on, as the node declares it; a source reads no
/// stream.
fn stream_of(node: &dyn Node, trigger: &Trigger) -> Option<String> {
    match trigger {
        Trigger::Message { input, .. } => node.inputs().get(*input).map(|topic| topic.name.clone()),
        Trigger::Tick => None,
    }
}

fn status_of(node: &dyn Node) -> impl Iterator<Item = (String, String)> {
    node.status().into_iter().map(|(key, value)| (key.to_owned(), value))
}

fn keeps_latest(kind: MessageKind) -> bool {
    matches!(kind, MessageKind::Image | MessageKind::CompressedImage | MessageKind::CameraInfo)
}
