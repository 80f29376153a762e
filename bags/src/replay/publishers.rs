//! The publishers of a replay: one for each topic and type of the bag, and one for `/clock`.

use std::collections::BTreeMap;
use std::sync::Arc;

use modulo_msgs::builtin::Time;
use modulo_msgs::rosgraph_msgs;
use modulo_msgs::{Interface, cdr};
use modulo_runtime::graph::NameError;
use modulo_runtime::transport::TransportError;
use modulo_runtime::transport::keys::{self, Endpoint};
use modulo_runtime::transport::zenoh::{RawPublisher, ZenohTransport};
use modulo_runtime::{NodeName, Qos};

use crate::bag::{BagReader, BagTopic, RawMessage, qos};

/// The publishers of the topics of a bag. A topic that the bag has with two types gets two of them.
pub(super) struct Publishers(Vec<TopicPublisher>);

struct TopicPublisher {
    topic: Arc<BagTopic>,
    /// Name of the topic in the graph.
    name: String,
    publisher: RawPublisher,
    sent: u64,
}

impl Publishers {
    /// Declares all topics of `bag` except that of `time`, of which there must be only one source.
    pub(super) fn declare(
        transport: &ZenohTransport,
        node_name: &NodeName,
        bag: &BagReader,
        time: Option<&ClockPublisher>,
    ) -> Result<Self, TransportError> {
        let mut publishers = Vec::new();
        for topic in bag.topics().into_iter().map(|counted| counted.topic) {
            let endpoint = endpoint(&topic, node_name)?;
            if time.is_some_and(|time| time.name == endpoint.topic) {
                tracing::warn!("{} of the bag is left out: --clock publishes it", endpoint.topic);
                continue;
            }
            let publisher = transport.advertise_raw(node_name, &endpoint)?;
            publishers.push(TopicPublisher { topic, name: endpoint.topic, publisher, sent: 0 });
        }
        Ok(Self(publishers))
    }

    /// Returns whether one of the topics has a reader.
    pub(super) fn wanted(&self) -> bool {
        self.0.iter().any(|topic| topic.publisher.wanted())
    }

    /// Sends the payload of `message` unchanged, on the publisher of its topic and type.
    pub(super) fn send(&mut self, message: RawMessage) -> Result<(), TransportError> {
        let BagTopic { name, type_name, .. } = &*message.topic;
        let its = |to: &&mut TopicPublisher| to.topic.name == *name && to.topic.type_name == *type_name;
        let Some(topic) = self.0.iter_mut().find(its) else { return Ok(()) };
        topic.publisher.put(message.data)?;
        topic.sent += 1;
        Ok(())
    }

    /// Returns the number of messages that were sent, by topic. Topics without messages are left out.
    pub(super) fn sent(&self) -> BTreeMap<String, u64> {
        let mut sent = BTreeMap::new();
        for topic in self.0.iter().filter(|topic| topic.sent > 0) {
            *sent.entry(topic.name.clone()).or_default() += topic.sent;
        }
        sent
    }
}

/// The publisher of the time of the bag.
pub(super) struct ClockPublisher {
    name: String,
    publisher: RawPublisher,
    /// Ticks between two messages, ns.
    every: u64,
    next: u64,
}

impl ClockPublisher {
    /// Declares `/clock`, published `hz` times a second.
    pub(super) fn declare(
        transport: &ZenohTransport,
        node_name: &NodeName,
        hz: f64,
    ) -> Result<Self, TransportError> {
        let endpoint = endpoint(&BagTopic::new("/clock", rosgraph_msgs::Clock::NAME, Qos::Clock), node_name)?;
        let publisher = transport.advertise_raw(node_name, &endpoint)?;
        Ok(Self { name: endpoint.topic, publisher, every: (1e9 / hz) as u64, next: 0 })
    }

    /// Publishes `time`, ns since the epoch, if that is due at the ticks `now`.
    pub(super) fn publish(&mut self, now: u64, time: u64) -> Result<(), TransportError> {
        if now < self.next {
            return Ok(());
        }
        // A late message is not made up for.
        self.next = self.next.saturating_add(self.every).max(now);
        let message = rosgraph_msgs::Clock { clock: Time::from_ns(time) };
        let payload = cdr::to_vec(&message).map_err(|why| TransportError::new("time of the bag", why))?;
        self.publisher.put(payload)
    }

    /// Returns the ticks from `now` until the next message is due.
    pub(super) fn ticks_until_due(&self, now: u64) -> u64 {
        self.next.saturating_sub(now)
    }
}

fn endpoint(topic: &BagTopic, node_name: &NodeName) -> Result<Endpoint, TransportError> {
    let refused = |why: NameError| TransportError::new("topic of the bag", why);
    let type_hash = if topic.type_hash.is_empty() { keys::NO_HASH } else { &topic.type_hash };
    Ok(Endpoint {
        topic: node_name.resolve(&topic.name).map_err(refused)?,
        dds_type: modulo_msgs::dds_name(&topic.type_name),
        type_hash: type_hash.to_owned(),
        qos: keys::qos_string(qos::parse(&topic.qos)).to_owned(),
    })
}
