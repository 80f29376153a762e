//! The transport of messages from node to node: `local` within a process (shared, never serialised), or `zenoh`.

pub mod local;
pub mod queue;
pub mod zenoh;

use std::fmt;
use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;

use modulo_runtime::wire::attachment::Attachment;
use modulo_runtime::wire::keys::{EntityKind, Token};
use modulo_runtime::{Address, Message, MessageKind, NodeName, ParameterError, Parameters, Value};

use crate::graph::Graph;
use crate::graph::discovery::LostPublisher;
use crate::transport::queue::Queued;

/// Shared bytes; cheap to clone, read as a slice.
#[derive(Clone)]
pub struct Payload(Arc<dyn AsRef<[u8]> + Send + Sync>);

impl Payload {
    /// Returns the bytes of `keeper`.
    pub fn new(keeper: impl AsRef<[u8]> + Send + Sync + 'static) -> Self {
        Self(Arc::new(keeper))
    }
}

impl Deref for Payload {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        (*self.0).as_ref()
    }
}

impl fmt::Debug for Payload {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bytes", self.len())
    }
}

/// A sample as it came over the wire.
#[derive(Clone, Debug)]
pub struct RawSample {
    /// CDR with its encapsulation header.
    pub payload: Payload,
    /// The number that the publisher gave it; nodes of a ROS stack always send one.
    pub attachment: Option<Attachment>,
}

impl Queued for RawSample {
    fn bytes(&self) -> usize {
        self.payload.len()
    }

    fn attachment(&self) -> Option<&Attachment> {
        self.attachment.as_ref()
    }
}

/// A message that waits in a queue. A sample is not decoded yet, so that a replaced image costs no decoding.
#[derive(Clone, Debug)]
pub enum Incoming {
    /// A message from the same process.
    Message(Message),
    /// CDR from another one.
    Sample(RawSample),
}

impl Queued for Incoming {
    fn attachment(&self) -> Option<&Attachment> {
        match self {
            Self::Message(_) => None,
            Self::Sample(sample) => sample.attachment(),
        }
    }
}

/// Takes each message of a subscription, on a thread of the transport. It must not wait.
pub type Deliver = Box<dyn Fn(Incoming) + Send + Sync>;

impl Incoming {
    /// Returns the message inside, which must be of `kind`.
    ///
    /// # Errors
    /// The reason why the bytes are no message of that kind.
    pub fn open(self, kind: MessageKind) -> Result<Message, String> {
        match self {
            Self::Message(message) => Ok(message),
            Self::Sample(sample) => Message::decode(kind, &sample.payload),
        }
    }
}

/// A publisher. Dropping it takes it out of the graph.
pub trait Publisher: Send {
    /// Returns whether the topic has a reader now.
    fn wanted(&self) -> bool;

    /// Returns its global id and the number of messages that have left it; `None` within one process.
    fn sent(&self) -> Option<([u8; 16], u64)> {
        None
    }

    /// Sends one message to all readers.
    fn put(&self, message: &Message) -> Result<(), TransportError>;
}

/// Changes of parameters asked for from outside, answered between two steps.
#[derive(Debug)]
pub struct ParameterRequest {
    /// Changes that are applied one after the other. Of a change, either all values are set or none of them.
    pub changes: Vec<Vec<(String, Value)>>,
    /// Receiver of the answer.
    pub answer: Sender<ParameterAnswer>,
    /// Decides between the node that applies the request and the caller that gives up.
    pub claim: Claim,
}

/// The answer of a node to a [`ParameterRequest`].
#[derive(Debug, PartialEq, Eq)]
pub enum ParameterAnswer {
    /// The node has begun to load what the changes need, such as a model. They take effect after that; `Done` follows.
    Loading,
    /// One result for each change.
    Done(Vec<Result<(), ParameterError>>),
}

/// A right that exactly one of its holders gets: clones share it.
#[derive(Clone, Debug, Default)]
pub struct Claim(Arc<AtomicBool>);

impl Claim {
    /// Returns whether the caller is the first to ask.
    pub fn take(&self) -> bool {
        !self.0.swap(true, Ordering::SeqCst)
    }

    /// Returns whether a holder has the right already.
    pub fn is_taken(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }
}

/// The access of a transport to the parameters of a node.
pub struct ParameterPort {
    /// Reads the current set.
    pub read: Box<dyn Fn() -> Parameters + Send + Sync>,
    /// Hands a request to the node's loop; returns whether the node takes it, and has not too many and is not ending.
    pub request: Box<dyn Fn(ParameterRequest) -> bool + Send + Sync>,
}

/// Pauses a node (`false`) or lets it go on; the error is the reason why it has not done so.
pub type Enable = Box<dyn Fn(bool) -> Result<(), String> + Send + Sync>;

/// A node of the graph. Nodes of two sessions may have one name, as when a suite runs twice in a domain.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct NodeId {
    /// Fully qualified name.
    pub name: String,
    /// The session that it belongs to.
    pub session: String,
}

impl NodeId {
    fn of(token: &Token) -> Self {
        Self { name: token.node_name(), session: token.session.clone() }
    }
}

/// Something that must stay alive for a declaration to hold.
pub type Guard = Box<dyn Send + Sync>;

/// Runs its closure when it is dropped, such as to end a declaration.
pub(crate) struct OnDrop<F: FnMut()>(pub F);

impl<F: FnMut()> Drop for OnDrop<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}

/// A carrier of messages. An operation that it cannot do is a [`TransportError`].
pub trait Transport: Send + Sync {
    /// Declares a publisher of `node`.
    fn advertise(&self, node: &NodeName, address: &Address) -> Result<Box<dyn Publisher>, TransportError>;

    /// Declares a subscription of `node`, which lasts until the guard is dropped.
    fn subscribe(
        &self,
        node: &NodeName,
        address: &Address,
        deliver: Deliver,
    ) -> Result<Guard, TransportError>;

    /// Shows `node` in the graph: from now on it counts as ready.
    fn announce(&self, node: &NodeName) -> Result<Guard, TransportError>;

    /// Makes the node's parameters reachable from outside.
    fn serve_parameters(&self, node: &NodeName, port: ParameterPort) -> Result<Guard, TransportError>;

    /// Offers the service `~/enable` of `node`; `enable` pauses the node or lets it go on, and returns when that is done. A
    /// transport within one process offers it to no caller.
    fn serve_enable(&self, node: &NodeName, enable: Enable) -> Result<Guard, TransportError> {
        let _ = (node, enable);
        Ok(Box::new(()))
    }

    /// Returns the graph as it is now.
    fn graph(&self) -> Arc<Graph>;

    /// Returns the session that the nodes of this transport belong to.
    fn session(&self) -> String;

    /// Returns the nodes that are announced now.
    fn nodes(&self) -> Vec<NodeId> {
        let graph = self.graph();
        graph.tokens().filter(|token| token.kind == EntityKind::Node).map(NodeId::of).collect()
    }

    /// Returns what tells a node called `node` of this session from those of others.
    fn id_of(&self, node: &NodeName) -> NodeId {
        NodeId { name: node.fully_qualified(), session: self.session() }
    }

    /// Returns the node of each endpoint of `kind` on `topic` now.
    fn endpoints(&self, kind: EntityKind, topic: &str) -> Vec<NodeId> {
        self.graph().endpoints(kind, topic).map(NodeId::of).collect()
    }

    /// Returns whether the node with this fully qualified name has been announced.
    fn is_ready(&self, node: &str) -> bool {
        self.graph().has_node(node)
    }

    /// Returns the fully qualified names of the nodes that publish `topic` now.
    fn publishers(&self, topic: &str) -> Vec<String> {
        self.endpoints(EntityKind::Publisher, topic).into_iter().map(|node| node.name).collect()
    }

    /// Returns (topic, node) of each publisher, or each subscription, of messages of `kind` now.
    fn users(&self, end: EntityKind, kind: MessageKind) -> Vec<(String, String)> {
        let (graph, dds_type) = (self.graph(), modulo_msgs::dds_name(kind.type_name()));
        let of_kind = graph.tokens().filter(|token| token.kind == end).filter_map(|token| {
            let endpoint = token.endpoint.as_ref().filter(|endpoint| endpoint.dds_type == dds_type)?;
            Some((endpoint.topic.clone(), token.node_name()))
        });
        of_kind.collect()
    }

    /// Returns the number of the last message that a publisher has told to have sent.
    fn last_sent(&self, publisher: &[u8; 16]) -> Option<i64> {
        let _ = publisher;
        None
    }

    /// Returns the publisher of `topic` whose link was lost, until its node publishes the topic again.
    fn lost_publisher(&self, topic: &str) -> Option<LostPublisher> {
        let _ = topic;
        None
    }

    /// Returns the time after the end of the last publisher during which a message may still be on its way.
    fn settling(&self) -> std::time::Duration;
}

/// Error: the transport did not do what was requested.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what}: {why}")]
pub struct TransportError {
    /// The operation, with its topic or node.
    pub what: String,
    /// The error of the transport.
    pub why: String,
}

impl TransportError {
    /// Creates the error of the operation `what`.
    pub fn new(what: impl Into<String>, why: impl std::fmt::Display) -> Self {
        Self { what: what.into(), why: why.to_string() }
    }
}
