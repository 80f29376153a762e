//! [`Slot`]: one input of a live node, and its change from one stream to another without a gap.
//!
//! Until the first frame of the new stream has come, the old one is still read and answered. From then on only the new
//! one is answered; the old one is read until it has reached that frame, so that frames that were on their way are
//! counted. Both streams may show the same frames, and one may be behind the other: a frame of the new stream that is
//! not newer than the last answered one counts as replaced.

use std::sync::Arc;
use std::time::Duration;

use modulo_runtime::clock::nanos;
use modulo_runtime::report::add;
use modulo_runtime::topic::Durability;
use modulo_runtime::{Address, NodeReport, Qos, Topic};

use super::EventQueue;
use crate::transport::queue::{Lane, LaneCounts};
use crate::transport::{Guard, Transport};

/// A new stream without a frame for this long is warned of. An old stream that has not reached the first frame of the
/// new one within this time is closed.
const PATIENCE: Duration = Duration::from_secs(2);
/// The longest time by which one stream may be behind another one. A frame that is older than the last answered one by
/// more than this belongs to another time base, such as that of a recording.
const MAX_LAG: Duration = Duration::from_secs(10);

pub(super) struct SlotInput {
    /// The topic as the node declares it.
    pub topic: Topic,
    pub address: Address,
    pub lane: Lane,
    pub queue: Arc<EventQueue>,
    /// There until it ends, which is before its lane is closed.
    pub subscription: Option<Guard>,
}

impl SlotInput {
    /// Adds what it has heard of each publisher to `report`, with what is missing at their ends; `lasts` is whether it goes on.
    pub fn hear(&self, transport: &dyn Transport, lasts: bool, report: &mut NodeReport) {
        let Address { topic, qos, profile, .. } = &self.address;
        let is_kept = profile.is_some_and(|profile| profile.durability == Durability::TransientLocal);
        // Late readers get the last message of such a topic on another way than its numbers.
        if *qos != Qos::Latched && !is_kept {
            let heard = self.queue.heard(self.lane, |publisher| transport.last_sent(publisher));
            report.book_heard(topic, (self.lane.0, lasts), &heard);
        }
    }

    /// Ends the subscription and adds its counts to `report`; `lasted` is whether the node ends as well.
    pub fn close(mut self, transport: &dyn Transport, lasted: bool, report: &mut NodeReport) {
        self.hear(transport, lasted, report);
        self.subscription = None;
        let counts = self.queue.close(self.lane);
        if let Some(warning) = counts.warning(&self.address.topic) {
            tracing::warn!("{warning}");
        }
        book(report, &self.address, counts);
    }
}

impl Drop for SlotInput {
    /// Ends a subscription that the node has never read, and that is in no report.
    fn drop(&mut self) {
        self.subscription = None;
        self.queue.close(self.lane);
    }
}

/// One input of a node: a stream that is answered, and those that come and go.
pub(super) struct Slot {
    /// The stream whose frames are answered.
    answered: SlotInput,
    /// While its next frames may have been answered from another stream: the stamp of the last one that was, or 0.
    overlap: Option<u64>,
    pending: Option<PendingStream>,
    /// Streams that are no longer answered, each with the frame that it is read up to.
    leaving: Vec<(SlotInput, Successor)>,
    /// Stamps of the first and the last answered frame, ns, since they last went backwards.
    span: Option<(u64, u64)>,
}

/// The stream that the node has asked for, while no frame of it has come.
struct PendingStream {
    input: SlotInput,
    /// Where the node has left this stream before, if it has.
    left: Option<Successor>,
    since: u64,
    warned: bool,
}

/// The stamp of the first frame of the stream after a left one, which is read up to it, and the ticks at its arrival.
struct Successor {
    first: u64,
    since: u64,
}

impl Slot {
    pub fn new(input: SlotInput) -> Self {
        Self { answered: input, overlap: None, pending: None, leaving: Vec::new(), span: None }
    }

    /// Returns the stream that the node has asked for.
    pub fn current(&self) -> &SlotInput {
        self.pending.as_ref().map_or(&self.answered, |pending| &pending.input)
    }

    /// Returns the subscriptions that are open now.
    pub fn inputs(&self) -> impl Iterator<Item = &SlotInput> {
        let pending = self.pending.iter().map(|pending| &pending.input);
        std::iter::once(&self.answered).chain(pending).chain(self.leaving.iter().map(|(input, _)| input))
    }

    /// Returns all subscriptions.
    pub fn into_inputs(self) -> impl Iterator<Item = SlotInput> {
        let pending = self.pending.map(|pending| pending.input);
        std::iter::once(self.answered).chain(pending).chain(self.leaving.into_iter().map(|(input, _)| input))
    }

    /// Returns the stream whose frames are answered.
    pub fn in_use(&self) -> &Topic {
        &self.answered.topic
    }

    /// Returns whether a subscription to `address` is open.
    pub fn reads(&self, address: &Address) -> bool {
        self.inputs().any(|input| input.address == *address)
    }

    /// Changes to the stream at `to`, which the node declares as `topic`, at the ticks `now`. `opened` is the subscription
    /// to it where none is open. Returns a subscription that is no longer needed.
    pub fn change(
        &mut self,
        topic: Topic,
        to: &Address,
        opened: Option<SlotInput>,
        now: u64,
    ) -> Option<SlotInput> {
        let current = self.pending.as_mut().map_or(&mut self.answered, |pending| &mut pending.input);
        if current.address == *to {
            current.topic = topic;
            return None;
        }
        let next = if self.answered.address == *to {
            self.answered.topic = topic;
            None
        } else {
            let (mut input, left) = opened.map_or_else(|| self.take_back(to), |opened| (opened, None));
            input.topic = topic;
            Some(PendingStream { input, left, since: now, warned: false })
        };
        // The last stream that was asked for has not begun.
        let PendingStream { input, left, .. } = std::mem::replace(&mut self.pending, next)?;
        let Some(left) = left else { return Some(input) };
        self.leaving.push((input, left));
        None
    }

    /// Returns the stream at `to`, which was left and is still open.
    fn take_back(&mut self, to: &Address) -> (SlotInput, Option<Successor>) {
        let index = self.leaving.iter().position(|(input, _)| input.address == *to);
        let (input, left) = self.leaving.remove(index.expect("a stream without a subscription is opened"));
        (input, Some(left))
    }

    /// Takes note of a message of `stamp` (ns; 0 is unknown) that came in `lane` at the ticks `now`. Returns whether it
    /// is answered, and a subscription that is no longer needed.
    pub fn admit(&mut self, lane: Lane, stamp: u64, now: u64) -> (bool, Option<SlotInput>) {
        if let Some(index) = self.leaving.iter().position(|(input, _)| input.lane == lane) {
            let over = stamp >= self.leaving[index].1.first;
            return (false, over.then(|| self.leaving.remove(index).0));
        }
        if let Some(begun) = self.pending.take_if(|pending| pending.input.lane == lane) {
            let left = std::mem::replace(&mut self.answered, begun.input);
            self.leaving.push((left, Successor { first: stamp, since: now }));
            self.overlap = Some(0);
        }
        // A smaller stamp means that the source has restarted, not that the frame is a repetition.
        let least = |last, from: u64, to: u64| from.max(last).max(to.saturating_sub(nanos(MAX_LAG)));
        let known = |(last, (from, to))| (least(last, from, to)..=to).contains(&stamp);
        if stamp != 0 && self.overlap.zip(self.span).is_some_and(known) {
            self.overlap = Some(stamp);
            return (false, None);
        }
        self.overlap = None;
        self.span = match self.span {
            Some((from, to)) if stamp > to => Some((from, stamp)),
            _ => Some((stamp, stamp)),
        };
        (true, None)
    }

    /// Returns a warning if one is due at the ticks `now`, and a subscription that is no longer needed.
    pub fn look(&mut self, now: u64) -> (Option<String>, Option<SlotInput>) {
        let late = |(_, left): &(_, Successor)| now.saturating_sub(left.since) > nanos(PATIENCE);
        let closed = self.leaving.iter().position(late).map(|index| self.leaving.remove(index).0);
        let is_due = |pending: &&mut PendingStream| !pending.warned && now >= pending.since + nanos(PATIENCE);
        let Some(pending) = self.pending.as_mut().filter(is_due) else { return (None, closed) };
        pending.warned = true;
        let warning = format!(
            "no frame has come on {} for {} s; the node still answers the frames of {}",
            pending.input.address.topic,
            Duration::from_nanos(now - pending.since).as_secs(),
            self.answered.address.topic
        );
        (Some(warning), closed)
    }
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

#[cfg(test)]
#[path = "tests/swap.rs"]
mod tests;
