//! [`Pacing`]: a source with rate 0 sends its next frame when the slowest
//! reader has taken the last one, so that no frame is replaced by a newer one.
//!
//! Each live node tells on [`TOPIC`] which frame it has taken. A node that passes
//! images on tells it when its step is over, and names the topics on which it
//! has published, so that the source also waits for the readers of those; any
//! other node tells it before its step, so that the source can make the next
//! frame meanwhile. The messages are only sent while a source listens.

use std::collections::BTreeSet;
use std::sync::Arc;

use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::std_msgs::{Header, Time};

use crate::graph::Topic;
use crate::message::{Message, MessageKind};
use crate::transport::Transport;

/// Where nodes tell which frame they have taken; `ros2 topic list` hides it, as
/// every name with a leading underscore.
const TOPIC: &str = "/_modulo/taken";

/// The topic, as publishers and subscribers declare it.
pub(super) fn topic() -> Topic {
    Topic::new(TOPIC, MessageKind::Diagnostics)
}

/// The message that `node` has taken the frame of `stamp`, and published what
/// came of it on `topics`.
pub(super) fn taken(node: &str, stamp: Time, topics: &[String]) -> Message {
    let values = topics.iter().map(|topic| KeyValue { key: topic.clone(), value: String::new() }).collect();
    let status = DiagnosticStatus { name: node.to_owned(), values, ..DiagnosticStatus::default() };
    let header = Header { stamp, frame_id: String::new() };
    Message::Diagnostics(Arc::new(DiagnosticArray { header, status: vec![status] }))
}

/// The last frame of a source, and who has taken it.
#[derive(Default)]
pub(super) struct Pacing {
    stamp: Option<Time>,
    /// Topics on which the frame, or what came of it, was published.
    topics: BTreeSet<String>,
    /// Nodes that have taken it.
    taken: BTreeSet<String>,
}

impl Pacing {
    /// A frame of `stamp` leaves on `topics`.
    pub fn sent(&mut self, stamp: Time, topics: impl IntoIterator<Item = String>) {
        *self = Self { stamp: Some(stamp), topics: topics.into_iter().collect(), taken: BTreeSet::new() };
    }

    /// A message of [`TOPIC`] has come. Those of earlier frames are ignored.
    pub fn note(&mut self, message: &DiagnosticArray) {
        if Some(message.header.stamp) == self.stamp {
            for status in &message.status {
                self.taken.insert(status.name.clone());
                self.topics.extend(status.values.iter().map(|value| value.key.clone()));
            }
        }
    }

    /// Nodes that have not taken the frame yet. Only those are waited for that
    /// publish [`TOPIC`]: other readers, such as a viewer, set no pace. A node that
    /// leaves the graph is not waited for any longer.
    pub fn waits_for(&self, transport: &dyn Transport) -> Vec<String> {
        let telling: BTreeSet<String> = transport.publishers(TOPIC).into_iter().collect();
        let readers = self.topics.iter().flat_map(|topic| transport.subscribers(topic));
        let readers: BTreeSet<String> = readers.filter(|reader| telling.contains(reader)).collect();
        readers.difference(&self.taken).cloned().collect()
    }
}

/// The stamp of the first image among the `messages` of a step, and the topics of
/// all its images; `None` when there is no image.
pub(super) fn images<'a>(
    messages: &[(usize, Message)],
    topic_of: impl Fn(usize) -> Option<&'a str>,
) -> Option<(Time, Vec<String>)> {
    let images = || messages.iter().filter(|(_, message)| message.kind() == MessageKind::Image);
    let stamp = images().next()?.1.stamp();
    Some((stamp, images().filter_map(|(output, _)| topic_of(*output)).map(str::to_owned).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::NodeName;
    use crate::transport::local::LocalTransport;
    use crate::transport::{Address, Guard, Publisher};

    fn node_name(name: &str) -> NodeName {
        NodeName::new(name, "/", &[]).expect("a name")
    }

    /// A node that reads `topic` and tells what it takes.
    fn reader(transport: &LocalTransport, name: &str, topic: &str) -> (Guard, Box<dyn Publisher>) {
        let node_name = node_name(name);
        let input = Address::resolve(&node_name, &Topic::new(topic, MessageKind::Image)).expect("a name");
        let telling = Address::resolve(&node_name, &super::topic()).expect("a name");
        let subscription = transport.subscribe(&node_name, &input, Box::new(|_| ())).expect("local");
        (subscription, transport.advertise(&node_name, &telling).expect("local"))
    }

    fn note(pacing: &mut Pacing, node: &str, ns: u64, topics: &[String]) {
        let Message::Diagnostics(message) = taken(node, Time::from_ns(ns), topics) else { unreachable!() };
        pacing.note(&message);
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
        assert_eq!(pacing.waits_for(&transport), ["/unwrap"]);
        note(&mut pacing, "/unwrap", 4, &[]);
        assert_eq!(pacing.waits_for(&transport), ["/unwrap"], "that was an earlier frame");
        // The detector may be heard before the node that it reads from.
        note(&mut pacing, "/detector", 5, &[]);
        note(&mut pacing, "/unwrap", 5, &["/recovered".into()]);
        assert!(pacing.waits_for(&transport).is_empty());

        pacing.sent(Time::from_ns(6), ["/modulo".to_owned()]);
        note(&mut pacing, "/unwrap", 6, &["/recovered".into()]);
        assert_eq!(pacing.waits_for(&transport), ["/detector"]);
        drop(detector);
        assert!(pacing.waits_for(&transport).is_empty(), "a node that has gone is not waited for");

        pacing.sent(Time::from_ns(7), ["/modulo".to_owned()]);
        note(&mut pacing, "/unwrap", 7, &[]);
        assert!(pacing.waits_for(&transport).is_empty(), "a frame that was skipped has no readers");
    }
}
