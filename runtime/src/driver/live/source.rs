//! The loop of a source: one frame each period, or at the pace of its readers ([`Pacing`]).

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::std_msgs::{Header, Time};

use super::{GRAPH_GLANCE, Live, LiveEvent, LiveOutput, REQUESTS, nanoseconds};
use crate::clock::Clock;
use crate::driver::RunError;
use crate::graph::Topic;
use crate::message::{Message, MessageKind};
use crate::node::{Flow, Trigger};
use crate::process::stop::Urgency;
use crate::queue::{Keep, Lane, Next};
use crate::transport::{Address, Guard, Transport};

/// A paced source goes on when a reader that is there has not taken a frame for this long.
const READER_LIMIT_NS: u64 = 60_000_000_000;

impl Live<'_> {
    /// Sends one frame each period, or with a period of zero as soon as every reader has taken the last frame. The
    /// period may change between two frames.
    pub(super) fn run_source(&mut self) -> Result<(), RunError> {
        // The subscription to what the readers have taken, which is held only while the period is zero.
        let mut told: Option<(Guard, Lane)> = None;
        // A node that watches the graph, as a recorder does, has subscribed by then.
        let mut due = self.time.ticks_ns() + nanoseconds(self.transport.settling());
        loop {
            let (before, paced) = (self.period_ns(), self.is_paced());
            if paced != told.is_some() {
                match told.take() {
                    Some((_, lane)) => drop(self.queue.close(lane)),
                    // Readers tell what they take only while a source listens, since it costs them a message
                    // for each frame.
                    None => told = Some(self.listen_to_readers()?),
                }
                // A frame of the time before says nothing about the readers at the new pace.
                self.pacing = Pacing::default();
                // Readers tell nothing before they have found out that this node listens.
                due = due.max(self.time.ticks_ns() + nanoseconds(self.transport.settling()));
            }
            self.wait_until(due)?;
            if self.stop.urgency() != Urgency::None {
                return Ok(());
            }
            let (flow, messages) = self.step(Trigger::Tick, "source")?;
            // The step has made the next frame meanwhile; only its sending waits.
            if paced {
                self.wait_for_readers()?;
                self.note_frame(&messages);
            }
            self.send_all(&messages);
            if flow == Flow::Done {
                return Ok(());
            }
            // Where the period has changed, the longer one holds for this once: nothing else keeps two frames apart.
            let period = self.period_ns().max(before);
            due = next_due(due, period, self.time.ticks_ns());
        }
    }

    fn period_ns(&self) -> u64 {
        self.node.period().map_or(0, nanoseconds)
    }

    fn is_paced(&self) -> bool {
        self.node.period() == Some(Duration::ZERO)
    }

    fn listen_to_readers(&self) -> Result<(Guard, Lane), RunError> {
        let (queue, lane) = (self.queue.clone(), self.queue.open(Keep::Last(REQUESTS)));
        let deliver = Box::new(move |incoming| drop(queue.push(lane, LiveEvent::Taken(incoming))));
        let address = Address::resolve(&self.node_name, &taken_topic())?;
        Ok((self.transport.subscribe(&self.node_name, &address, deliver)?, lane))
    }

    /// Handles at most one event that waits, and all that come until `due`.
    fn wait_until(&mut self, due: u64) -> Result<(), RunError> {
        loop {
            // With no time left it still takes one event that waits, so that a fast source answers requests as well.
            let patience = due.saturating_sub(self.time.ticks_ns());
            match self.queue.take(Some(Duration::from_nanos(patience))) {
                Next::Item(arrived) => drop(self.handle(arrived)?),
                Next::Idle | Next::Ended => {}
            }
            if self.time.ticks_ns() >= due || self.stop.urgency() != Urgency::None {
                return Ok(());
            }
        }
    }

    fn wait_for_readers(&mut self) -> Result<(), RunError> {
        let start = self.time.ticks_ns();
        loop {
            let missing = self.pacing.waits_for(self.transport);
            if missing.is_empty() || self.stop.urgency() != Urgency::None {
                return Ok(());
            }
            // A reader that hangs must not stop the camera for ever.
            if self.time.ticks_ns().saturating_sub(start) > READER_LIMIT_NS {
                let missing = missing.join(", ");
                tracing::warn!(node = %self.report.node, "{missing} has not taken a frame for 60 s: going on");
                return Ok(());
            }
            if let Next::Item(arrived) = self.queue.take(Some(GRAPH_GLANCE)) {
                self.handle(arrived)?;
            }
        }
    }

    /// Notes that from now on the readers of the images among `messages` are waited for.
    fn note_frame(&mut self, messages: &[(usize, Message)]) {
        if let Some((stamp, topics)) = images(messages, &self.outputs) {
            self.pacing.sent(stamp, topics);
        }
    }
}

/// Returns the time of the frame after the one due at `due`, in ns: the first multiple of `period` after it that is not
/// past. As a timer of ROS 2 does, a late source leaves frames out; it does not catch up in a burst.
fn next_due(due: u64, period: u64, now: u64) -> u64 {
    let late = now.saturating_sub(due);
    due + period * late.div_ceil(period.max(1)).max(1)
}

/// Where nodes tell which frame they have taken; `ros2 topic list` hides it, as every name with a leading underscore.
const TOPIC: &str = "/_modulo/taken";

/// Returns the topic, as publishers and subscribers declare it.
pub(super) fn taken_topic() -> Topic {
    Topic::new(TOPIC, MessageKind::Diagnostics)
}

/// Returns the message that `node` has taken the frame of `stamp`, and published what came of it on `topics`.
pub(super) fn taken_message(node: &str, stamp: Time, topics: &[String]) -> Message {
    let values = topics.iter().map(|topic| KeyValue { key: topic.clone(), value: String::new() }).collect();
    let status = DiagnosticStatus { name: node.to_owned(), values, ..DiagnosticStatus::default() };
    let header = Header { stamp, frame_id: String::new() };
    Message::Diagnostics(Arc::new(DiagnosticArray { header, status: vec![status] }))
}

/// The last frame of a source of rate 0, and the nodes that have taken it. Such a source sends its next frame when the
/// slowest reader has taken the last one, so that no frame is replaced by a newer one.
///
/// Each live node tells on [`TOPIC`] which frame it has taken. A node that passes images on tells it when its step is
/// over, and names the topics on which it has published, so that the source also waits for the readers of those; any
/// other node tells it before its step, so that the source can make the next frame meanwhile. The messages are only
/// sent while a source listens.
#[derive(Default)]
pub(super) struct Pacing {
    stamp: Option<Time>,
    /// Topics on which the frame, or what came of it, was published.
    topics: BTreeSet<String>,
    /// Nodes that have taken it.
    taken: BTreeSet<String>,
}

impl Pacing {
    /// Notes that a frame of `stamp` leaves on `topics`.
    pub fn sent(&mut self, stamp: Time, topics: impl IntoIterator<Item = String>) {
        *self = Self { stamp: Some(stamp), topics: topics.into_iter().collect(), taken: BTreeSet::new() };
    }

    /// Takes a message of [`TOPIC`]. Those of earlier frames are ignored.
    pub fn note(&mut self, message: &DiagnosticArray) {
        if Some(message.header.stamp) == self.stamp {
            for status in &message.status {
                self.taken.insert(status.name.clone());
                // What this node published comes from the frame, so the readers of that are waited for, too.
                self.topics.extend(status.values.iter().map(|value| value.key.clone()));
            }
        }
    }

    /// Returns the nodes that have not taken the frame yet. Only those are waited for that publish [`TOPIC`]: other
    /// readers, such as a viewer, set no pace. A node that leaves the graph is not waited for any longer.
    pub fn waits_for(&self, transport: &dyn Transport) -> Vec<String> {
        let telling: BTreeSet<String> = transport.publishers(TOPIC).into_iter().collect();
        let readers = self.topics.iter().flat_map(|topic| transport.subscribers(topic));
        // A viewer or a recorder tells nothing, and waiting for it would never end.
        let readers: BTreeSet<String> = readers.filter(|reader| telling.contains(reader)).collect();
        readers.difference(&self.taken).cloned().collect()
    }
}

/// Returns the stamp of the first image among the `messages` of a step, and the topics of all its images, compressed ones
/// included; `None` when there is no image.
pub(super) fn images(messages: &[(usize, Message)], outputs: &[LiveOutput]) -> Option<(Time, Vec<String>)> {
    let is_image = |message: &Message| matches!(message, Message::Image(_) | Message::CompressedImage(_));
    let images = || messages.iter().filter(|(_, message)| is_image(message));
    let stamp = images().next()?.1.stamp();
    let topic =
        |(output, message): &(usize, Message)| Some(outputs.get(*output)?.route(message.kind()).0.to_owned());
    Some((stamp, images().filter_map(topic).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::NodeName;
    use crate::transport::local::LocalTransport;
    use crate::transport::{Address, Guard, Publisher};

    #[test]
    fn a_late_source_leaves_frames_out() {
        assert_eq!(next_due(1000, 100, 1000), 1100, "on time");
        assert_eq!(next_due(1000, 100, 1099), 1100, "late, but not for the next one");
        assert_eq!(next_due(1000, 100, 1100), 1100);
        assert_eq!(next_due(1000, 100, 1351), 1400, "two frames are left out");
        assert_eq!(next_due(1000, 0, 1351), 1000, "with no period, the next frame is due at once");
    }

    fn node_name(name: &str) -> NodeName {
        NodeName::new(name, "/", &[]).expect("a name")
    }

    /// A node that reads `topic` and tells what it takes.
    fn reader(transport: &LocalTransport, name: &str, topic: &str) -> (Guard, Box<dyn Publisher>) {
        let node_name = node_name(name);
        let input = Address::resolve(&node_name, &Topic::new(topic, MessageKind::Image)).expect("a name");
        let telling = Address::resolve(&node_name, &taken_topic()).expect("a name");
        let subscription = transport.subscribe(&node_name, &input, Box::new(|_| ())).expect("local");
        (subscription, transport.advertise(&node_name, &telling).expect("local"))
    }

    fn note(pacing: &mut Pacing, node: &str, ns: u64, topics: &[String]) {
        let Message::Diagnostics(message) = taken_message(node, Time::from_ns(ns), topics) else {
            unreachable!()
        };
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
