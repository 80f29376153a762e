//! [`Slot`]: one input of a live node, and its change from one stream to another without a gap.
//!
//! Until the first frame of the new stream has come, the old one is still read and answered. From then on only the new
//! one is answered; the old one is read until it has reached that frame, so that frames that were on their way are
//! counted. Both streams may show the same frames, and one may be behind the other: a frame of the new stream that is
//! not newer than the last answered one counts as replaced.

use std::time::Duration;

use modulo_runtime::clock::nanos;
use modulo_runtime::{Address, NodeReport, Topic};

use super::EventQueue;
use super::inputs::book;
use crate::transport::Guard;
use crate::transport::queue::Lane;

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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use proptest::prelude::*;

    use super::*;
    use crate::transport::queue::{Keep, Limit, Queue};
    use modulo_runtime::{ManualClock, MessageKind, Qos};

    const S: u64 = 1_000_000_000;

    struct Bench {
        queue: EventQueue,
        slot: Slot,
    }

    fn address(topic: &str) -> Address {
        Address { topic: topic.into(), kind: MessageKind::Image, qos: Qos::Images, profile: None }
    }

    fn open(queue: &EventQueue, topic: &str) -> SlotInput {
        let declared = Topic::new(topic, MessageKind::Image);
        SlotInput::new(declared, address(topic), queue.open(Keep::Latest), Box::new(()))
    }

    impl Bench {
        /// A node that reads `/a`.
        fn new() -> Self {
            let queue = Queue::new(Arc::new(ManualClock::at(0)), Limit { messages: 1, bytes: 1 });
            let slot = Slot::new(open(&queue, "/a"));
            Self { queue, slot }
        }

        /// Returns the topics that are closed.
        fn change(&mut self, topic: &str) -> Vec<String> {
            let opened = (!self.slot.reads(&address(topic))).then(|| open(&self.queue, topic));
            let closed = self.slot.change(Topic::new(topic, MessageKind::Image), &address(topic), opened, 0);
            closed.into_iter().map(|input| input.address.topic).collect()
        }

        /// Returns whether the frame of `stamp` is answered, and the topic that is closed.
        fn frame(&mut self, topic: &str, stamp: u64) -> (bool, Option<String>) {
            let lane = self.slot.inputs().find(|input| input.address.topic == topic).expect("open").lane;
            let (answered, closed) = self.slot.admit(lane, stamp, 0);
            (answered, closed.map(|input| input.address.topic))
        }
    }

    const ANSWERED: (bool, Option<String>) = (true, None);
    const REPLACED: (bool, Option<String>) = (false, None);

    #[test]
    fn a_stream_behind_the_old_one_begins_with_its_first_new_frame() {
        let mut bench = Bench::new();
        assert_eq!([4, 5].map(|stamp| bench.frame("/a", stamp)), [ANSWERED; 2]);
        assert_eq!(bench.change("/b"), [""; 0]);
        assert_eq!(bench.frame("/a", 6), ANSWERED, "the new stream has not begun");
        assert_eq!(bench.slot.in_use().name, "/a");
        assert_eq!(
            [5, 6].map(|stamp| bench.frame("/b", stamp)),
            [REPLACED; 2],
            "answered from the old stream"
        );
        assert_eq!(bench.frame("/a", 7), (false, Some("/a".into())), "the new stream shows it as well");
        assert_eq!([7, 8].map(|stamp| bench.frame("/b", stamp)), [ANSWERED; 2]);
        assert_eq!(bench.slot.in_use().name, "/b");
        assert_eq!(
            [8, 3].map(|stamp| bench.frame("/b", stamp)),
            [ANSWERED; 2],
            "without a swap, all are answered"
        );
    }

    #[test]
    fn frames_on_their_way_on_the_old_stream_are_counted() {
        let mut bench = Bench::new();
        assert_eq!(bench.frame("/a", 4), ANSWERED);
        bench.change("/b");
        assert_eq!(bench.frame("/b", 7), ANSWERED);
        assert_eq!([5, 6].map(|stamp| bench.frame("/a", stamp)), [REPLACED; 2]);
        assert_eq!(bench.frame("/a", 7), (false, Some("/a".into())));
        assert_eq!(bench.slot.inputs().count(), 1);
    }

    #[test]
    fn a_swap_back_takes_the_subscription_that_is_still_open() {
        let mut bench = Bench::new();
        assert_eq!(bench.frame("/a", 4), ANSWERED);
        bench.change("/b");
        assert_eq!(bench.change("/a"), ["/b"], "it has not begun");
        assert_eq!([5, 6].map(|stamp| bench.frame("/a", stamp)), [ANSWERED; 2]);
        bench.change("/b");
        assert_eq!(bench.frame("/b", 7), ANSWERED);
        assert_eq!(bench.change("/a"), [""; 0]);
        assert_eq!([bench.frame("/a", 7), bench.frame("/a", 8)], [REPLACED, ANSWERED]);
        assert_eq!(bench.frame("/b", 8), (false, Some("/b".into())));
        assert_eq!(bench.change("/c"), [""; 0]);
        assert_eq!(bench.change("/d"), ["/c"], "it has not begun, so that /a goes on");
        assert_eq!((bench.frame("/a", 9), bench.slot.in_use().name.as_str()), (ANSWERED, "/a"));
    }

    #[test]
    fn a_source_that_starts_again_and_frames_without_a_stamp_are_answered() {
        let mut bench = Bench::new();
        assert_eq!([4, 5, 6].map(|stamp| bench.frame("/a", stamp)), [ANSWERED; 3]);
        bench.change("/b");
        assert_eq!(
            [bench.frame("/b", 5), bench.frame("/b", 4), bench.frame("/b", 5)],
            [REPLACED, ANSWERED, ANSWERED]
        );
        let mut bench = Bench::new();
        assert_eq!([1, 11 * S, 20 * S].map(|stamp| bench.frame("/a", stamp)), [ANSWERED; 3]);
        bench.change("/b");
        assert_eq!(
            [10 * S, 9 * S].map(|stamp| bench.frame("/b", stamp)),
            [REPLACED, ANSWERED],
            "a recording"
        );
        let mut bench = Bench::new();
        assert_eq!(bench.frame("/a", 0), ANSWERED);
        bench.change("/b");
        assert_eq!([0, 0].map(|stamp| bench.frame("/b", stamp)), [ANSWERED; 2]);
    }

    #[test]
    fn a_stream_that_gives_no_frame_is_warned_of_each_second() {
        let mut bench = Bench::new();
        bench.change("/b");
        let mut told = |now| bench.slot.look(now).0;
        let warning =
            |s| format!("no frame has come on /b for {s} s; the node still answers the frames of /a");
        assert_eq!([told(2 * S - 1), told(2 * S), told(3 * S - 1)], [None, Some(warning(2)), None]);
        assert_eq!([told(3 * S), told(5 * S)], [3, 5].map(|s| Some(warning(s))));
        assert_eq!(bench.frame("/a", 1), ANSWERED);
        assert_eq!(bench.frame("/b", 2), ANSWERED);
        assert!(bench.slot.look(2 * S).1.is_none(), "the old stream may still reach the new one");
        let (warning, closed) = bench.slot.look(2 * S + 1);
        assert_eq!((warning, closed.map(|input| input.address.topic)), (None, Some("/a".into())));
    }

    proptest! {
        /// Three streams of the same frames, each with a delay of its own, and swaps at any time: no frame is answered
        /// twice, their order stays, and from the first answered frame on each one is answered or seen as replaced.
        #[test]
        fn no_frame_is_answered_twice_or_missing(
            delays in [0u64..4, 0u64..4, 0u64..4],
            swaps in prop::collection::vec((8u64..64, 0usize..3), 0..12),
        ) {
            let names = ["/a", "/b", "/c"];
            let mut bench = Bench::new();
            let (mut answered, mut seen) = (Vec::new(), std::collections::BTreeSet::new());
            for time in 4u64..64 {
                for (_, to) in swaps.iter().filter(|(at, _)| *at == time) {
                    if bench.slot.current.address.topic != names[*to] {
                        bench.change(names[*to]);
                    }
                }
                for (name, delay) in names.iter().zip(&delays) {
                    let stamp = time - delay;
                    if bench.slot.inputs().any(|input| input.address.topic == *name) {
                        seen.insert(stamp);
                        if bench.frame(name, stamp).0 {
                            answered.push(stamp);
                        }
                    }
                }
            }
            prop_assert!(answered.is_sorted_by(|a, b| a < b), "{answered:?}");
            let first = *answered.first().expect("a stream is always read");
            prop_assert!((first..60).all(|stamp| seen.contains(&stamp)), "{seen:?}");
        }
    }
}
