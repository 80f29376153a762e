//! [`Slot`]: one input of a live node, and its change from one stream to another without a gap.
//!
//! Until the first frame of the new stream has come, the old one is still read and answered. From then on only the new
//! one is answered; the old one is read until it has reached that frame, so that frames that were on their way are
//! counted. Both streams may show the same frames, and one may be behind the other: a frame of the new stream that is
//! not newer than the last answered one counts as replaced.

use std::time::Duration;

use modulo_runtime::clock::nanos;
use modulo_runtime::report::add;
use modulo_runtime::{Address, NodeReport, Qos, Topic};

use super::EventQueue;
use crate::transport::Guard;
use crate::transport::queue::{Lane, LaneCounts};

/// A new stream without a frame for this long is warned of. An old stream that has not reached the first frame of the
/// new one within this time is closed.
const PATIENCE: Duration = Duration::from_secs(2);
/// Time between two such warnings.
const WARNING_PERIOD: Duration = Duration::from_secs(1);
/// The longest time by which one stream may be behind another one. A frame that is older than the last answered one by
/// more than this is no frame of before: the stream has another time, such as a recording.
const MAX_LAG: Duration = Duration::from_secs(10);

/// A topic that a node reads, with its subscription.
pub(super) struct SlotInput {
    /// The topic as the node declares it.
    pub topic: Topic,
    pub address: Address,
    pub lane: Lane,
    /// While the next frames of this topic may have been answered from another one: the stamp of the last one that was,
    /// or 0.
    overlap: Option<u64>,
    /// Where the node left this topic, while it has asked for it again and no frame of it has come since.
    left: Option<Left>,
    subscription: Guard,
}

impl SlotInput {
    pub fn new(topic: Topic, address: Address, lane: Lane, subscription: Guard) -> Self {
        Self { topic, address, lane, overlap: None, left: None, subscription }
    }

    /// Ends a subscription that the node has never read.
    pub fn cancel(self, queue: &EventQueue) {
        drop(self.subscription);
        queue.close(self.lane);
    }

    /// Ends the subscription and adds its counts to `report`.
    pub fn close(self, queue: &EventQueue, report: &mut NodeReport) {
        drop(self.subscription);
        book(report, &self.address, queue.close(self.lane));
    }
}

/// One input of a node.
pub(super) struct Slot {
    /// The stream that the node has asked for.
    pub current: SlotInput,
    waiting: Option<PendingSwap>,
    leaving: Vec<Leaving>,
    /// Stamps of the first and the last answered frame, ns, since they last went backwards.
    answered: Option<(u64, u64)>,
}

/// The current stream has given no frame yet, so that `old` is answered.
struct PendingSwap {
    old: SlotInput,
    since: u64,
    warn_at: u64,
}

/// A stream that is no longer answered.
struct Leaving {
    old: SlotInput,
    left: Left,
}

/// The frame with which the stream after a left one began: its stamp, and the ticks at which it came. The left stream is
/// read until it has reached this frame.
#[derive(Clone, Copy)]
struct Left {
    first: u64,
    since: u64,
}

impl Slot {
    pub fn new(input: SlotInput) -> Self {
        Self { current: input, waiting: None, leaving: Vec::new(), answered: None }
    }

    /// Returns the subscriptions that are open now.
    pub fn inputs(&self) -> impl Iterator<Item = &SlotInput> {
        let waiting = self.waiting.iter().map(|waiting| &waiting.old);
        std::iter::once(&self.current).chain(waiting).chain(self.leaving.iter().map(|leaving| &leaving.old))
    }

    /// Returns all subscriptions.
    pub fn into_inputs(self) -> impl Iterator<Item = SlotInput> {
        let waiting = self.waiting.map(|waiting| waiting.old);
        std::iter::once(self.current)
            .chain(waiting)
            .chain(self.leaving.into_iter().map(|leaving| leaving.old))
    }

    /// Returns the stream whose frames are answered.
    pub fn in_use(&self) -> &Topic {
        &self.waiting.as_ref().map_or(&self.current, |waiting| &waiting.old).topic
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
        if self.current.address == *to {
            self.current.topic = topic;
            return None;
        }
        // The last stream has not begun, so that the one before it is still the one that is answered.
        if let Some(PendingSwap { old, .. }) = self.waiting.take_if(|waiting| waiting.old.address == *to) {
            let last = std::mem::replace(&mut self.current, SlotInput { topic, ..old });
            return self.put_aside(last);
        }
        let next = SlotInput { topic, overlap: Some(0), ..opened.unwrap_or_else(|| self.take_back(to)) };
        let last = std::mem::replace(&mut self.current, next);
        let begun = self.waiting.take();
        let pending = |old| Some(PendingSwap { old, since: now, warn_at: now + nanos(PATIENCE) });
        match begun {
            Some(PendingSwap { old, .. }) => {
                self.waiting = pending(old);
                self.put_aside(last)
            }
            None => {
                self.waiting = pending(last);
                None
            }
        }
    }

    /// Returns the stream at `to`, which was left and is still open.
    fn take_back(&mut self, to: &Address) -> SlotInput {
        let index = self.leaving.iter().position(|leaving| leaving.old.address == *to);
        let Leaving { old, left } =
            self.leaving.remove(index.expect("a stream without a subscription is opened"));
        SlotInput { left: Some(left), ..old }
    }

    /// Leaves a stream that has not begun; returns it if it is no longer needed.
    fn put_aside(&mut self, input: SlotInput) -> Option<SlotInput> {
        match input.left {
            Some(left) => self.leaving.push(Leaving { old: input, left }),
            None => return Some(input),
        }
        None
    }

    /// Takes note of a message of `stamp` (ns; 0 is unknown) that came in `lane` at the ticks `now`. Returns whether it
    /// is answered, and a subscription that is no longer needed.
    pub fn admit(&mut self, lane: Lane, stamp: u64, now: u64) -> (bool, Option<SlotInput>) {
        if let Some(index) = self.leaving.iter().position(|leaving| leaving.old.lane == lane) {
            let over = stamp >= self.leaving[index].left.first;
            return (false, over.then(|| self.leaving.remove(index).old));
        }
        let is_new = lane == self.current.lane;
        if let Some(PendingSwap { old, .. }) = self.waiting.take_if(|_| is_new) {
            self.leaving.push(Leaving { old, left: Left { first: stamp, since: now } });
            self.current.left = None;
        }
        let input = match &mut self.waiting {
            Some(waiting) => &mut waiting.old,
            None => &mut self.current,
        };
        // A smaller stamp means that the source has restarted, not that the frame is a repetition.
        let least = |last, from: u64, to: u64| from.max(last).max(to.saturating_sub(nanos(MAX_LAG)));
        let known = |(last, (from, to))| (least(last, from, to)..=to).contains(&stamp);
        if stamp != 0 && input.overlap.zip(self.answered).is_some_and(known) {
            input.overlap = Some(stamp);
            return (false, None);
        }
        input.overlap = None;
        self.answered = match self.answered {
            Some((from, to)) if stamp > to => Some((from, stamp)),
            _ => Some((stamp, stamp)),
        };
        (true, None)
    }

    /// Looks at the time that the swap takes, at the ticks `now`. Returns a warning if one is due, and a subscription
    /// that is no longer needed.
    pub fn look(&mut self, now: u64) -> (Option<String>, Option<SlotInput>) {
        let late = |leaving: &Leaving| now.saturating_sub(leaving.left.since) > nanos(PATIENCE);
        let closed = self.leaving.iter().position(late).map(|index| self.leaving.remove(index).old);
        let Some(waiting) = self.waiting.as_mut().filter(|waiting| now >= waiting.warn_at) else {
            return (None, closed);
        };
        waiting.warn_at = now + nanos(WARNING_PERIOD);
        let warning = format!(
            "no frame has come on {} for {} s; the node still answers the frames of {}",
            self.current.address.topic,
            Duration::from_nanos(now - waiting.since).as_secs(),
            waiting.old.address.topic
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
mod tests;
