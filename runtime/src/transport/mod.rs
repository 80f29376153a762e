//! How messages get from node to node. Two carriers behind one trait: `local`
//! within a process (shared, never serialised) and `zenoh` between processes.

pub mod attachment;
pub mod conflict;
pub mod gaps;
pub mod graph;
pub mod keys;
pub mod local;
pub mod payload;
pub mod profile;
pub mod zenoh;

use std::sync::Arc;
use std::sync::mpsc::Sender;

use crate::inbox::Inbox;
use crate::message::{DecodeError, Message, MessageKind};
use crate::name::Place;
use crate::parameter::{Parameters, Refusal, Value};
use crate::topic::Qos;
use payload::Payload;

/// A topic as the graph sees it: absolute and remapped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Absolute name.
    pub topic: String,
    /// What it carries.
    pub kind: MessageKind,
    /// How it is carried.
    pub qos: Qos,
}

/// A message as it waits in an inbox: whole, or still as the wire brought it,
/// so that a replaced image costs no decoding.
#[derive(Clone, Debug)]
pub enum Parcel {
    /// From the same process.
    Message(Message),
    /// CDR from another one.
    Bytes(Payload),
}

impl Parcel {
    /// The message inside, which must be of `kind`.
    ///
    /// # Errors
    /// [`DecodeError`] when the bytes are no message of that kind.
    pub fn open(self, kind: MessageKind) -> Result<Message, DecodeError> {
        match self {
            Self::Message(message) => Ok(message),
            Self::Bytes(bytes) => Message::decode(kind, &bytes),
        }
    }
}

/// A publisher. Dropping it takes it out of the graph.
pub trait Outlet: Send {
    /// Whether anybody reads this topic now.
    fn wanted(&self) -> bool;

    /// Sends one message.
    ///
    /// # Errors
    /// [`TransportError`] when it could not be handed over.
    fn put(&self, message: &Message) -> Result<(), TransportError>;
}

/// A subscription. Dropping it takes it out of the graph.
pub trait Inlet: Send + Sync {
    /// Messages known to be lost on the way here.
    fn lost(&self) -> u64;
}

/// A change of parameters asked for from outside, answered between two steps.
#[derive(Debug)]
pub struct ParameterRequest {
    /// What to set, all or nothing.
    pub changes: Vec<(String, Value)>,
    /// Where the answer goes.
    pub answer: Sender<Result<(), Refusal>>,
}

/// What a transport needs to serve a node's parameters.
pub struct ParameterPort {
    /// Reads the current set.
    pub read: Box<dyn Fn() -> Parameters + Send + Sync>,
    /// Takes requests to the node's loop.
    pub requests: Sender<ParameterRequest>,
}

/// Something that must stay alive for a declaration to hold.
pub type Guard = Box<dyn Send + Sync>;

/// A carrier of messages.
pub trait Transport: Send + Sync {
    /// Declares a publisher of `node`.
    ///
    /// # Errors
    /// [`TransportError`] when the carrier refuses.
    fn advertise(&self, node: &Place, address: &Address) -> Result<Box<dyn Outlet>, TransportError>;

    /// Declares a subscription of `node`; messages go to `slot` of `inbox`.
    ///
    /// # Errors
    /// [`TransportError`] when the carrier refuses.
    fn subscribe(
        &self,
        node: &Place,
        address: &Address,
        inbox: Arc<Inbox<Parcel>>,
        slot: usize,
    ) -> Result<Box<dyn Inlet>, TransportError>;

    /// Shows `node` in the graph: from now on it counts as ready.
    ///
    /// # Errors
    /// [`TransportError`] when the carrier refuses.
    fn announce(&self, node: &Place) -> Result<Guard, TransportError>;

    /// Makes the node's parameters reachable from outside.
    ///
    /// # Errors
    /// [`TransportError`] when the carrier refuses.
    fn serve_parameters(&self, node: &Place, port: ParameterPort) -> Result<Guard, TransportError>;

    /// Whether the node with this fully qualified name has been announced.
    fn is_ready(&self, node: &str) -> bool;

    /// Whether anybody publishes `topic` now.
    fn has_publisher(&self, topic: &str) -> bool;

    /// How long after the last publisher has gone a message may still be on
    /// its way.
    fn settling(&self) -> std::time::Duration;
}

/// Why the carrier did not do what was asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what}: {why}")]
pub struct TransportError {
    /// What was tried, on which topic or node.
    pub what: String,
    /// What the carrier said.
    pub why: String,
}

impl TransportError {
    /// An error of trying `what`.
    pub fn new(what: impl Into<String>, why: impl std::fmt::Display) -> Self {
        Self { what: what.into(), why: why.to_string() }
    }
}
