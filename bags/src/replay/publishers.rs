//! The publishers of a replay: one a topic of the bag, and `/clock`.

use std::collections::BTreeMap;

use modulo_msgs::builtin::Time;
use modulo_msgs::rosgraph_msgs;
use modulo_msgs::{Interface, cdr};
use modulo_runtime::transport::TransportError;
use modulo_runtime::transport::keys::{self, Endpoint};
use modulo_runtime::transport::zenoh::{RawPublisher, ZenohTransport};
use modulo_runtime::{NodeName, Qos};

use crate::bag::{BagReader, BagTopic, RawMessage, qos};

/// Publishers of the topics of a bag.
pub(super) struct Publishers {
    by_topic: BTreeMap<String, TopicPublisher>,
}

struct TopicPublisher {
    /// In the graph.
    name: String,
    publisher: RawPublisher,
    sent: u64,
}

impl Publishers {
    /// Declares all topics of `bag`, but for that of `time`, which has only one
    /// truth.
    pub(super) fn declare(
        transport: &ZenohTransport,
        node_name: &NodeName,
        bag: &BagReader,
        time: Option<&ClockPublisher>,
    ) -> Result<Self, TransportError> {
        let mut by_topic = BTreeMap::new();
        for counted in bag.topics() {
            let endpoint = endpoint(&counted.topic, node_name)?;
            if time.is_some_and(|time| time.name == endpoint.topic) {
                tracing::warn!("{} of the bag is left out: --clock publishes it", endpoint.topic);
                continue;
            }
            let publisher = transport.advertise_raw(node_name, &endpoint)?;
            let named = TopicPublisher { name: endpoint.topic, publisher, sent: 0 };
            by_topic.insert(counted.topic.name.clone(), named);
        }
        Ok(Self { by_topic })
    }

    /// Whether anybody reads one of the topics.
    pub(super) fn wanted(&self) -> bool {
        self.by_topic.values().any(|named| named.publisher.wanted())
    }

    /// Sends `message` as it is.
    pub(super) fn send(&mut self, message: RawMessage) -> Result<(), TransportError> {
        let Some(named) = self.by_topic.get_mut(&message.topic.name) else { return Ok(()) };
        named.publisher.put(message.data)?;
        named.sent += 1;
        Ok(())
    }

    /// How many messages were sent, by topic; only those that had one.
    pub(super) fn sent(&self) -> BTreeMap<String, u64> {
        let mut sent = BTreeMap::new();
        for named in self.by_topic.values().filter(|named| named.sent > 0) {
            *sent.entry(named.name.clone()).or_default() += named.sent;
        }
        sent
    }
}

/// The publisher of the bag's time.
pub(super) struct ClockPublisher {
    name: String,
    publisher: RawPublisher,
    /// Ticks between two messages, ns.
    every: u64,
    next: u64,
}

impl ClockPublisher {
    /// Declares `/clock`, told `hz` times a second.
    pub(super) fn declare(
        transport: &ZenohTransport,
        node_name: &NodeName,
        hz: f64,
    ) -> Result<Self, TransportError> {
        let endpoint = endpoint(&BagTopic::new("/clock", rosgraph_msgs::Clock::NAME, Qos::Clock), node_name)?;
        let publisher = transport.advertise_raw(node_name, &endpoint)?;
        Ok(Self { name: endpoint.topic, publisher, every: (1e9 / hz) as u64, next: 0 })
    }

    /// Tells `time`, ns since the epoch, if that is due at `now`.
    pub(super) fn tell(&mut self, now: u64, time: u64) -> Result<(), TransportError> {
        if now < self.next {
            return Ok(());
        }
        // One that is late is not made up for.
        self.next = self.next.saturating_add(self.every).max(now);
        let message = rosgraph_msgs::Clock { clock: Time::from_ns(time) };
        let payload = cdr::to_vec(&message).map_err(|why| TransportError::new("time of the bag", why))?;
        self.publisher.put(payload)
    }

    /// How long after `now` the next message is due.
    pub(super) fn ticks_until_due(&self, now: u64) -> u64 {
        self.next.saturating_sub(now)
    }
}

fn endpoint(topic: &BagTopic, node_name: &NodeName) -> Result<Endpoint, TransportError> {
    let named = |why: modulo_runtime::graph::NameError| TransportError::new("topic of the bag", why);
    let type_hash = if topic.type_hash.is_empty() { keys::NO_HASH } else { &topic.type_hash };
    Ok(Endpoint {
        topic: node_name.resolve(&topic.name).map_err(named)?,
        dds_type: modulo_msgs::dds_name(&topic.type_name),
        type_hash: type_hash.to_owned(),
        qos: keys::qos_string(qos::parse(&topic.qos)).to_owned(),
    })
}
