//! [`Pacing`]: a source that sends its next frame when the slowest reader has taken the last one.

use std::collections::BTreeSet;

use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::std_msgs::Time;
use modulo_runtime::wire::keys::EntityKind;
use modulo_runtime::{Clock, Message, MessageKind, Topic};

use crate::transport::{NodeId, Transport};

/// A paced source goes on when a reader that is there has not taken a frame for this long.
const READER_LIMIT_NS: u64 = 60_000_000_000;
/// The same where another node publishes on the same topics: its frame may have replaced this one, so that no reader takes it.
const SHARED_LIMIT_NS: u64 = 300_000_000;

/// Where nodes acknowledge the frames that they have taken; `ros2 topic list` hides it, as every name with a leading underscore.
pub(super) const TOPIC: &str = "/_modulo/taken";

/// Returns the topic, as publishers and subscribers declare it.
pub fn ack_topic() -> Topic {
    Topic::new(TOPIC, MessageKind::Diagnostics)
}

/// Returns whether there is a node that does not publish [`ack_topic`], as each live node of the suite does. A recorder or a viewer
/// looks for publishers in the graph and subscribes some time after they have come.
pub(super) fn has_watcher(transport: &dyn Transport) -> bool {
    let acknowledging = transport.endpoints(EntityKind::Publisher, TOPIC);
    transport.nodes().iter().any(|node| !acknowledging.contains(node))
}

/// Returns the message that `node` has taken the frame of `stamp`, and published what came of it on `topics`.
pub(super) fn ack_message(node: NodeId, stamp: Time, topics: &[String]) -> Message {
    let NodeId { name, session: hardware_id } = node;
    let values = KeyValue::all(topics.iter().map(|topic| (topic, String::new())));
    let status = DiagnosticStatus { name, hardware_id, values, ..DiagnosticStatus::default() };
    DiagnosticArray::of(stamp, status).into()
}

/// The last frame of a source of rate 0, and the nodes that have taken it. Such a source sends its next frame when the
/// slowest reader has taken the last one, so that no frame is replaced by a newer one.
///
/// Each live node acknowledges on [`ack_topic`] the frame that it has taken. A node that passes images on does it when its step
/// is over, and names the topics on which it has published, so that the source also waits for the readers of those; any
/// other node does it before its step, so that the source can make the next frame meanwhile. The messages are only
/// sent while a source listens.
#[derive(Default)]
pub struct Pacing {
    stamp: Option<Time>,
    /// Topics on which the frame, or what came of it, was published.
    topics: BTreeSet<String>,
    acknowledged: BTreeSet<NodeId>,
    /// When [`Pacing::holds`] was asked first, in ticks of the clock.
    waiting_since: Option<u64>,
}

impl Pacing {
    /// Notes that a frame of `stamp` leaves on `topics`.
    pub fn sent(&mut self, stamp: Time, topics: impl IntoIterator<Item = String>) {
        *self = Self { stamp: Some(stamp), topics: topics.into_iter().collect(), ..Self::default() };
    }

    /// Returns whether an image of `stamp` on `topic` is one more of the last frame; its readers are waited for, too.
    pub fn adds(&mut self, stamp: Time, topic: &str) -> bool {
        self.stamp == Some(stamp) && self.topics.insert(topic.to_owned())
    }

    /// Takes a message of [`ack_topic`]. Those of earlier frames are ignored.
    pub fn note(&mut self, message: &DiagnosticArray) {
        if Some(message.header.stamp) == self.stamp {
            for status in &message.status {
                let (name, session) = (status.name.clone(), status.hardware_id.clone());
                self.acknowledged.insert(NodeId { name, session });
                // What this node published comes from the frame, so the readers of that are waited for, too.
                self.topics.extend(status.values.iter().map(|value| value.key.clone()));
            }
        }
    }

    /// Returns whether the next frame has to wait for a reader. A reader that hangs does not stop a source for ever: after 60 s
    /// of waiting the answer is no, with a warning, and after 0.3 s where the source is not the only one of its topics.
    pub fn holds(&mut self, transport: &dyn Transport, clock: &dyn Clock) -> bool {
        let missing = self.waits_for(transport);
        let since = *self.waiting_since.get_or_insert(clock.ticks_ns());
        let publishers = |topic| transport.endpoints(EntityKind::Publisher, topic);
        let is_shared =
            self.topics.iter().any(|topic| publishers(topic).into_iter().collect::<BTreeSet<_>>().len() > 1);
        let limit = if is_shared { SHARED_LIMIT_NS } else { READER_LIMIT_NS };
        if missing.is_empty() || clock.ticks_ns().saturating_sub(since) <= limit {
            return !missing.is_empty();
        }
        if !is_shared {
            let names: Vec<String> = missing.into_iter().map(|node| node.name).collect();
            tracing::warn!("{} has not taken a frame for 60 s: going on", names.join(", "));
        }
        *self = Self::default();
        false
    }

    /// Returns the nodes that have not taken the frame yet. Only those are waited for that publish [`ack_topic`]: other
    /// readers, such as a viewer, set no pace. A node that leaves the graph is not waited for any longer.
    fn waits_for(&self, transport: &dyn Transport) -> Vec<NodeId> {
        let nodes = |kind, topic| transport.endpoints(kind, topic).into_iter();
        let acknowledging: BTreeSet<NodeId> = nodes(EntityKind::Publisher, TOPIC).collect();
        let readers = self.topics.iter().flat_map(|topic| nodes(EntityKind::Subscription, topic));
        // A viewer or a recorder acknowledges nothing, and waiting for it would never end.
        let readers: BTreeSet<NodeId> = readers.filter(|reader| acknowledging.contains(reader)).collect();
        readers.difference(&self.acknowledged).cloned().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::local::LocalTransport;
    use crate::transport::{Guard, Publisher};
    use modulo_runtime::{Address, ManualClock, NodeName};

    fn node_name(name: &str) -> NodeName {
        NodeName::new(name, "/", &[]).expect("a name")
    }

    /// A node that reads `topic` and tells what it takes.
    fn reader(transport: &LocalTransport, name: &str, topic: &str) -> (Guard, Box<dyn Publisher>) {
        let node_name = node_name(name);
        let input = Address::resolve(&node_name, &Topic::new(topic, MessageKind::Image)).expect("a name");
        let acknowledging = Address::resolve(&node_name, &ack_topic()).expect("a name");
        let subscription = transport.subscribe(&node_name, &input, Box::new(|_| ())).expect("local");
        (subscription, transport.advertise(&node_name, &acknowledging).expect("local"))
    }

    fn note(pacing: &mut Pacing, node: &str, ns: u64, topics: &[String]) {
        let session = LocalTransport::default().session();
        note_of(pacing, NodeId { name: node.to_owned(), session }, ns, topics);
    }

    fn note_of(pacing: &mut Pacing, node: NodeId, ns: u64, topics: &[String]) {
        let Message::Diagnostics(message) = ack_message(node, Time::from_ns(ns), topics) else {
            unreachable!()
        };
        pacing.note(&message);
    }

    #[test]
    fn a_node_that_tells_nothing_watches_the_graph() {
        let transport = LocalTransport::default();
        let _unwrap = (reader(&transport, "unwrap", "/modulo"), transport.announce(&node_name("unwrap")));
        assert!(!has_watcher(&transport));
        let recorder = transport.announce(&node_name("rosbag2_recorder"));
        assert!(has_watcher(&transport));
        drop(recorder);
        assert!(!has_watcher(&transport));
    }

    #[test]
    fn a_source_waits_for_every_reader_down_the_chain() {
        let transport = LocalTransport::default();
        let _unwrap = reader(&transport, "unwrap", "/modulo");
        let detector = reader(&transport, "detector", "/recovered");
        let viewer = Address::resolve(&node_name("viewer"), &Topic::new("/modulo", MessageKind::Image));
        let deliver = Box::new(|_| ());
        let _viewer = transport.subscribe(&node_name("viewer"), &viewer.expect("a name"), deliver);
        let mut pacing = Pacing::default();
        assert!(pacing.waits_for(&transport).is_empty(), "the first frame waits for no reader");

        pacing.sent(Time::from_ns(5), ["/modulo".to_owned()]);
        let waits_for = |pacing: &Pacing| -> Vec<String> {
            pacing.waits_for(&transport).into_iter().map(|node| node.name).collect()
        };
        assert_eq!(waits_for(&pacing), ["/unwrap"]);
        note(&mut pacing, "/unwrap", 4, &[]);
        assert_eq!(waits_for(&pacing), ["/unwrap"], "that was an earlier frame");
        let namesake = NodeId { name: "/unwrap".into(), session: "another suite".into() };
        note_of(&mut pacing, namesake, 5, &[]);
        assert_eq!(waits_for(&pacing), ["/unwrap"], "that was another node of this name");
        // The detector may be heard before the node that it reads from.
        note(&mut pacing, "/detector", 5, &[]);
        note(&mut pacing, "/unwrap", 5, &["/recovered".into()]);
        assert!(pacing.waits_for(&transport).is_empty());

        pacing.sent(Time::from_ns(6), ["/modulo".to_owned()]);
        note(&mut pacing, "/unwrap", 6, &["/recovered".into()]);
        assert_eq!(waits_for(&pacing), ["/detector"]);
        drop(detector);
        assert!(pacing.waits_for(&transport).is_empty(), "a node that has gone is not waited for");

        pacing.sent(Time::from_ns(7), ["/modulo".to_owned()]);
        note(&mut pacing, "/unwrap", 7, &[]);
        assert!(pacing.waits_for(&transport).is_empty(), "a frame that was skipped has no readers");
    }

    #[test]
    fn a_reader_that_hangs_holds_a_source_for_a_minute() {
        let (transport, clock) = (LocalTransport::default(), ManualClock::at(0));
        let _hangs = reader(&transport, "unwrap", "/modulo");
        let mut pacing = Pacing::default();
        pacing.sent(Time::from_ns(5), ["/modulo".to_owned()]);
        assert!(pacing.adds(Time::from_ns(5), "/left"));
        assert!(
            !pacing.adds(Time::from_ns(5), "/left") && !pacing.adds(Time::from_ns(6), "/left"),
            "the next frame"
        );
        assert!(pacing.holds(&transport, &clock));
        clock.set(READER_LIMIT_NS);
        assert!(pacing.holds(&transport, &clock));
        clock.set(READER_LIMIT_NS + 1);
        assert!(!pacing.holds(&transport, &clock));
    }

    /// A camera stood still for a minute when the frame of another one had replaced its own.
    #[test]
    fn a_source_that_is_not_the_only_one_of_its_topic_goes_on() {
        let (transport, clock) = (LocalTransport::default(), ManualClock::at(0));
        let _unwrap = reader(&transport, "unwrap", "/modulo");
        let image = Address::resolve(&node_name("camera"), &Topic::new("/modulo", MessageKind::Image));
        let image = image.expect("a name");
        let advertise = |name| transport.advertise(&node_name(name), &image).expect("local");
        let (_camera, player) = (advertise("camera"), advertise("player"));
        let mut pacing = Pacing::default();
        pacing.sent(Time::from_ns(5), ["/modulo".to_owned()]);
        assert!(pacing.holds(&transport, &clock));
        clock.set(SHARED_LIMIT_NS + 1);
        assert!(!pacing.holds(&transport, &clock));
        drop(player);
        pacing.sent(Time::from_ns(6), ["/modulo".to_owned()]);
        assert!(pacing.holds(&transport, &clock));
        clock.set(2 * SHARED_LIMIT_NS + 2);
        assert!(pacing.holds(&transport, &clock), "it is the only one again");
    }
}
