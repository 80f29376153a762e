//! [`Peer`]: a ROS node in the test's own process.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use modulo_runtime::queue::{Keep, Limit, Queue};
use modulo_runtime::transport::keys::{Endpoint, Hashes, qos_string};
use modulo_runtime::transport::zenoh::ZenohTransport;
use modulo_runtime::transport::{Address, Guard, Incoming, Publisher, RawSample, Transport};
use modulo_runtime::{Clock, Message, MessageKind, NodeName, SystemClock, Topic};

use super::Bench;

/// A node `/peer` on the domain of a bench.
pub struct Peer {
    pub transport: ZenohTransport,
    pub node_name: NodeName,
    _announced: Guard,
}

/// What comes on a topic.
pub struct Heard {
    kind: MessageKind,
    queue: Arc<Queue<Incoming>>,
    _subscription: Guard,
}

impl Peer {
    pub fn new(bench: &Bench) -> Self {
        Self::with_hashes(bench, Hashes::Rihs01)
    }

    pub fn with_hashes(bench: &Bench, hashes: Hashes) -> Self {
        let clock: Arc<dyn Clock> = Arc::new(SystemClock::default());
        let transport = ZenohTransport::open(bench.domain.id, hashes, clock).expect("a session on loopback");
        let node_name = NodeName::new("peer", "/", &[]).expect("a name");
        let announced = transport.announce(&node_name).expect("a token");
        Self { transport, node_name, _announced: announced }
    }

    pub fn advertise(&self, topic: &str, kind: MessageKind) -> Box<dyn Publisher> {
        self.transport.advertise(&self.node_name, &address(topic, kind)).expect("a publisher")
    }

    /// Samples on `topic` as they come.
    pub fn listen(&self, topic: &str, kind: MessageKind) -> (Guard, Receiver<RawSample>) {
        let Address { topic, qos, .. } = address(topic, kind);
        let dds_type = modulo_msgs::dds_name(kind.type_name());
        let endpoint = Endpoint { topic, dds_type, type_hash: kind.type_hash(), qos: qos_string(qos).into() };
        let (samples, arrived) = channel();
        let take = move |sample| drop(samples.send(sample));
        (self.transport.subscribe_raw(&self.node_name, &endpoint, take).expect("a subscription"), arrived)
    }

    pub fn hear(&self, topic: &str, kind: MessageKind) -> Heard {
        let clock = Arc::new(SystemClock::default());
        let queue = Arc::new(Queue::new(clock, Limit { messages: 0, bytes: 0 }));
        let (waiting, lane) = (queue.clone(), queue.open(Keep::Last(1000)));
        let deliver = Box::new(move |incoming| drop(waiting.push(lane, incoming)));
        let subscription = self
            .transport
            .subscribe(&self.node_name, &address(topic, kind), deliver)
            .expect("a subscription");
        Heard { kind, queue, _subscription: subscription }
    }
}

fn address(topic: &str, kind: MessageKind) -> Address {
    let Topic { name, kind, qos } = Topic::new(topic, kind);
    Address { topic: name, kind, qos }
}

impl Heard {
    /// The next message within `patience`.
    pub fn next(&self, patience: Duration) -> Option<Message> {
        let incoming = self.queue.take(Some(patience)).item()?;
        Some(incoming.open(self.kind).expect("a message of its kind"))
    }

    /// The first message for which `wanted` holds.
    pub fn until(&self, what: &str, wanted: impl Fn(&Message) -> bool) -> Message {
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(30) {
            if let Some(message) = self.next(Duration::from_millis(100))
                && wanted(&message)
            {
                return message;
            }
        }
        panic!("waited in vain: {what}");
    }
}
