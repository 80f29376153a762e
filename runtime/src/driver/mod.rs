//! The three drivers of a step: `live` (one node on a transport, the newest
//! frame wins), `composed` (several live nodes in one process, on the local
//! transport) and `lockstep` (every frame once, in order, nothing dropped).

pub mod composed;
pub mod live;
pub mod lockstep;

use std::time::Duration;

use crate::message::MessageKind;
use crate::name::{NameError, Place};
use crate::node::Node;
use crate::node_time;
use crate::parameter::Allowed;
use crate::parameter::{Descriptor, Parameters, Refusal, Value};
use crate::topic::Topic;
use crate::transport::{Address, TransportError};

/// Why a driver ended before its node was done.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RunError {
    /// A topic or node name is none.
    #[error(transparent)]
    Name(#[from] NameError),
    /// The carrier refused.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// A parameter was refused at the start.
    #[error(transparent)]
    Parameter(#[from] Refusal),
    /// The step cannot go on.
    #[error("{node}: {why}")]
    Fatal {
        /// Fully qualified name.
        node: String,
        /// What the step said.
        why: String,
    },
    /// A node that this one waits for did not come.
    #[error("{node}: waited {seconds} s for {missing}, which is not there; start it, or change wait_for")]
    Waited {
        /// The node that waited.
        node: String,
        /// How long.
        seconds: u64,
        /// Names of the nodes that are missing.
        missing: String,
    },
}

/// Parameters that the driver itself understands, for every node.
pub fn declare_common() -> Vec<Descriptor> {
    vec![
        node_time::declare(),
        Descriptor::new(
            "wait_for",
            Value::Strings(Vec::new()),
            Allowed::Any,
            "names of nodes that must be ready before this one reports ready or sends its first frame",
        )
        .fixed(),
        Descriptor::new(
            "wait_timeout",
            Value::Double(60.0),
            Allowed::Doubles { from: 0.0, to: 3600.0 },
            "seconds to wait for the nodes of wait_for before giving up",
        )
        .fixed(),
    ]
}

fn wait_for(place: &Place, parameters: &Parameters) -> Result<(Vec<String>, Duration), NameError> {
    let Some(Value::Strings(names)) = parameters.get("wait_for") else {
        return Ok((Vec::new(), Duration::ZERO));
    };
    let names = names.iter().map(|name| place.resolve(name)).collect::<Result<_, _>>()?;
    Ok((names, Duration::from_secs_f64(parameters.double("wait_timeout"))))
}

fn address(place: &Place, topic: &Topic) -> Result<Address, NameError> {
    Ok(Address { topic: place.resolve(&topic.name)?, kind: topic.kind, qos: topic.qos })
}

fn addresses(place: &Place, topics: &[Topic]) -> Result<Vec<Address>, NameError> {
    topics.iter().map(|topic| address(place, topic)).collect()
}

fn facts_of(node: &dyn Node) -> impl Iterator<Item = (String, String)> {
    node.facts().into_iter().map(|(key, value)| (key.to_owned(), value))
}

fn keeps_latest(kind: MessageKind) -> bool {
    matches!(kind, MessageKind::Image | MessageKind::CompressedImage | MessageKind::CameraInfo)
}
