//! [`Inputs`]: the present subscriptions of a live node, a lane of its queue each, and [`SkipWarnings`]: warnings of
//! the messages on them that could not be read.

use std::collections::BTreeMap;
use std::sync::Arc;

use modulo_msgs::std_msgs::Time;

use super::swap::{Slot, SlotInput};
use super::{EventQueue, LiveEvent};
use crate::driver::keeps_latest;
use crate::graph::{NodeName, Qos, Topic};
use crate::message::MessageKind;
use crate::report::{NodeReport, add};
use crate::transport::queue::{Keep, Lane, LaneCounts};
use crate::transport::{Address, Transport, TransportError};

/// Messages of a results topic that wait for a busy node.
const RESULTS_WAITING: usize = 64;

/// The subscriptions of a node.
pub(super) struct Inputs {
    queue: Arc<EventQueue>,
    slots: Vec<Slot>,
}

impl Inputs {
    /// Returns a node's inputs before its first subscription.
    pub fn new(queue: Arc<EventQueue>) -> Self {
        Self { queue, slots: Vec::new() }
    }

    /// Subscribes the node `node_name` to `topics`, and leaves the others at the ticks `now`. An image topic that takes
    /// the place of another one takes over with its first image.
    pub fn renew(
        &mut self,
        topics: Vec<(Topic, Address)>,
        node_name: &NodeName,
        transport: &dyn Transport,
        now: u64,
        report: &mut NodeReport,
    ) -> Result<(), TransportError> {
        let (count, before) = (topics.len(), self.slots.len());
        for (index, (topic, address)) in topics.into_iter().enumerate() {
            let slot = self.slots.get_mut(index);
            if let Some(slot) = slot.filter(|slot| slot.current.address == address) {
                slot.current.topic = topic;
                continue;
            }
            let queue = &self.queue;
            let open = || subscribe(topic, address.clone(), node_name, transport, queue);
            match self.slots.get_mut(index) {
                Some(slot) => {
                    report.swapped = true;
                    slot.change(&address, now, open)?
                        .into_iter()
                        .for_each(|input| input.close(queue, report));
                }
                None => self.slots.push(Slot::new(open()?)),
            }
        }
        report.swapped |= before > count;
        for slot in self.slots.split_off(count) {
            slot.into_inputs().for_each(|input| input.close(&self.queue, report));
        }
        Ok(())
    }

    fn all(&self) -> impl Iterator<Item = &SlotInput> {
        self.slots.iter().flat_map(Slot::inputs)
    }

    /// Returns the names of all topics that are subscribed now.
    pub fn topics(&self) -> impl Iterator<Item = &str> {
        self.all().map(|input| input.address.topic.as_str())
    }

    /// Returns the input that is open in `lane`, with its index in the node's list; `None` for a closed one.
    pub fn of(&self, lane: Lane) -> Option<(usize, &SlotInput)> {
        let slots = self.slots.iter().enumerate();
        let mut inputs = slots.flat_map(|(index, slot)| slot.inputs().map(move |input| (index, input)));
        inputs.find(|(_, input)| input.lane == lane)
    }

    /// Returns the name of the image stream whose frames are answered now, as the node declares it.
    pub fn stream(&self) -> Option<&str> {
        let mut streams = self.slots.iter().map(Slot::in_use);
        streams.find(|topic| topic.kind == MessageKind::Image).map(|topic| topic.name.as_str())
    }

    /// Returns whether a message of `stamp` that came in `lane` is answered at the ticks `now`. One that is not counts
    /// as replaced in `report`.
    pub fn admit(&mut self, lane: Lane, stamp: Time, now: u64, report: &mut NodeReport) -> bool {
        let Some((index, input)) = self.of(lane) else { return false };
        let topic = input.address.topic.clone();
        let (answered, closed) = self.slots[index].admit(lane, stamp.as_ns(), now);
        if !answered {
            add(&mut report.replaced, &topic, 1);
        }
        closed.into_iter().for_each(|input| input.close(&self.queue, report));
        answered
    }

    /// Returns the warnings about streams that have given no frame since the node asked for them, at the ticks `now`, and
    /// closes streams that the node has left.
    pub fn look(&mut self, now: u64, report: &mut NodeReport) -> Vec<String> {
        let mut warnings = Vec::new();
        for slot in &mut self.slots {
            let (warning, closed) = slot.look(now);
            warnings.extend(warning);
            closed.into_iter().for_each(|input| input.close(&self.queue, report));
        }
        warnings
    }

    /// Adds the counts of these subscriptions so far to `report`; messages that still wait do not count as received.
    pub fn count(&self, report: &mut NodeReport) {
        for SlotInput { address, lane, .. } in self.all() {
            let counts = self.queue.counts(*lane);
            book(
                report,
                address,
                LaneCounts { received: counts.received - counts.unread, unread: 0, ..counts },
            );
        }
    }

    /// Ends all subscriptions and adds their counts to `report`.
    pub fn close(&mut self, report: &mut NodeReport) {
        let inputs = std::mem::take(&mut self.slots).into_iter().flat_map(Slot::into_inputs);
        inputs.for_each(|input| input.close(&self.queue, report));
    }
}

fn subscribe(
    topic: Topic,
    address: Address,
    node_name: &NodeName,
    transport: &dyn Transport,
    queue: &Arc<EventQueue>,
) -> Result<SlotInput, TransportError> {
    // A newer image makes an older one useless, but each result counts.
    let keep = if keeps_latest(address.kind) { Keep::Latest } else { Keep::Last(RESULTS_WAITING) };
    let (lane, waiting) = (queue.open(keep), queue.clone());
    let deliver = Box::new(move |incoming| drop(waiting.push(lane, LiveEvent::Message(incoming))));
    let subscription = transport.subscribe(node_name, &address, deliver)?;
    Ok(SlotInput::new(topic, address, lane, subscription))
}

pub(super) fn book(report: &mut NodeReport, Address { topic, qos, .. }: &Address, counts: LaneCounts) {
    // A message without room in the queue counts as lost on its way, not as received.
    add(&mut report.received, topic, counts.received - counts.overflowed);
    add(&mut report.replaced, topic, counts.replaced);
    add(&mut report.lost, topic, counts.lost());
    add(&mut report.unread, topic, counts.unread);
    let of_its_kind = match qos {
        Qos::Images | Qos::Clock => &mut report.best_effort,
        Qos::Latched => &mut report.latched,
        Qos::Results | Qos::Events | Qos::Logs => return,
    };
    of_its_kind.insert(topic.clone());
}

/// Shortest time between two warnings about one topic.
const WARNING_PERIOD_NS: u64 = 1_000_000_000;

/// Warns of skipped messages at most once a second for each topic, with the number of those that were not told. A
/// publisher whose images cannot be read would otherwise fill the log at its rate.
#[derive(Default)]
pub(super) struct SkipWarnings {
    /// By topic: ticks of the last warning, and the number of skipped messages since then.
    topics: BTreeMap<String, (u64, u64)>,
}

impl SkipWarnings {
    /// Notes that a message of `topic` was skipped at the ticks `now`; returns the text of a warning if one is due.
    pub fn note(&mut self, topic: &str, why: &str, now: u64) -> Option<String> {
        let Some((last, untold)) = self.topics.get_mut(topic) else {
            self.topics.insert(topic.to_owned(), (now, 0));
            return Some(format!("skipped: {why}"));
        };
        *untold += 1;
        if now.saturating_sub(*last) < WARNING_PERIOD_NS {
            return None;
        }
        *last = now;
        Some(match std::mem::take(untold) {
            1 => format!("skipped: {why}"),
            count => format!("skipped: {why} (one of {count} since the last warning)"),
        })
    }

    /// Returns each topic with skipped messages that no warning has counted, with the text of the last warning.
    pub fn rest(&mut self) -> Vec<(String, String)> {
        let topics = std::mem::take(&mut self.topics).into_iter();
        let untold = topics.filter(|(_, (_, untold))| *untold > 0);
        untold.map(|(topic, (_, n))| (topic, format!("skipped: {n} more since the last warning"))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skipped_messages_are_told_once_a_second_and_none_is_left_out_of_the_count() {
        const MS: u64 = 1_000_000;
        let mut warnings = SkipWarnings::default();
        assert_eq!(warnings.note("/a", "cut", 0).as_deref(), Some("skipped: cut"));
        assert_eq!(warnings.note("/b", "cut", 10 * MS).as_deref(), Some("skipped: cut"), "another topic");
        assert_eq!(warnings.note("/a", "odd", 500 * MS), None);
        assert_eq!(warnings.note("/a", "odd", 999 * MS), None);
        let told = warnings.note("/a", "cut", 1000 * MS);
        assert_eq!(told.as_deref(), Some("skipped: cut (one of 3 since the last warning)"));
        assert_eq!(warnings.note("/a", "odd", 9000 * MS).as_deref(), Some("skipped: odd"));
        assert_eq!(warnings.note("/a", "odd", 9001 * MS), None);
        assert_eq!(warnings.rest(), [("/a".to_owned(), "skipped: 1 more since the last warning".to_owned())]);
        assert_eq!(warnings.rest(), []);
    }
}
