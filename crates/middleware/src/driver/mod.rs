//! The drivers of a step over a transport: `live` (one node), and `composed` (several live nodes in one process).

pub mod composed;
pub mod live;
pub mod pacing;

use std::time::Duration;

use modulo_images::FileFormat;
use modulo_runtime::clock::nanos;
use modulo_runtime::name::NameError;
use modulo_runtime::{Clock, ParameterError, Stop, Urgency};

use crate::transport::{Transport, TransportError};

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
    /// The step of a node, with its name, cannot go on, or a node that it waits for did not come.
    #[error("{0}: {1}")]
    Fatal(String, String),
}

/// The variant of image topics that a node reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageTransport {
    /// `sensor_msgs/msg/Image`
    Raw,
    /// `sensor_msgs/msg/CompressedImage`
    Compressed,
}

modulo_runtime::parameters! {
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
