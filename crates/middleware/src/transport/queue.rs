//! [`Queue`]: the one place where messages wait for a reader, be it a node, a recorder or a command. It is bounded,
//! counts every message that is not read, stamps each one on arrival, and its reader blocks on a condition variable
//! which [`Stop`](modulo_runtime::stop::Stop) wakes.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use modulo_runtime::Clock;
use modulo_runtime::stop::Wake;
use modulo_runtime::wire::attachment::{Attachment, Gaps, Heard, Step};

/// The number of messages that a lane holds, and the message that it drops when it is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// The lane holds only the newest message. Replacing an older message is not a loss.
    Latest,
    /// The newest `n` messages, at least one; the oldest is lost when one more comes.
    Last(usize),
    /// The lane holds all messages while the queue is within its [`Limit`]; one for which there is no room is lost.
    All,
}

/// The most that the lanes with [`Keep::All`] hold together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limit {
    /// Largest number of messages.
    pub messages: usize,
    /// Bytes of their payloads.
    pub bytes: usize,
}

/// One lane of a queue, the messages of one topic or of one service, by its number: lanes are counted in the order in which
/// they are opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Lane(pub u64);

/// Counts of one lane. Of the messages that arrived, `received - replaced - overflowed - unread` were read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LaneCounts {
    /// Number of messages that arrived.
    pub received: u64,
    /// Messages that a newer one replaced before they were read ([`Keep::Latest`]).
    pub replaced: u64,
    /// Messages for which there was no room ([`Keep::Last`], [`Keep::All`]).
    pub overflowed: u64,
    /// Messages that wait now, or that still waited when the lane was closed.
    pub unread: u64,
    /// Messages that never arrived: gaps in the sequence numbers of the publishers. A jump of the numbers counts as one.
    pub missing: u64,
    /// How often the numbers of a publisher have jumped, so that nobody knows how many messages are missing.
    pub jumps: u64,
}

impl LaneCounts {
    /// Messages that were sent and should have been read, but were not.
    pub fn lost(&self) -> u64 {
        self.overflowed + self.missing
    }

    /// Returns what is not known of the losses on `topic`, if anything, in words.
    pub fn warning(&self, topic: &str) -> Option<String> {
        let jumps = self.jumps;
        (jumps > 0).then(|| {
            format!(
                "the sequence numbers on {topic} jumped by more than a million, {jumps} times: a publisher has started them anew, or \
                 is not one of ROS 2; how many messages are lost is not known, and each jump counts as one"
            )
        })
    }
}

/// An item that can wait in a [`Queue`].
pub trait Queued {
    /// Returns the bytes that it keeps in memory.
    fn bytes(&self) -> usize {
        0
    }

    /// Returns the publisher's sequence number, if the item came over the wire.
    fn attachment(&self) -> Option<&Attachment> {
        None
    }
}

/// An item with the circumstances of its arrival.
#[derive(Debug, PartialEq, Eq)]
pub struct Arrived<T> {
    /// The lane it came in.
    pub lane: Lane,
    /// Wall time of its arrival, ns since the epoch.
    pub stamp_ns: u64,
    /// The item.
    pub item: T,
}

/// Waiting items, in lanes. Share it by `Arc`.
pub struct Queue<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
    clock: Arc<dyn Clock>,
    limit: Limit,
}

struct State<T> {
    lanes: BTreeMap<Lane, Waiting<T>>,
    opened: u64,
    arrivals: u64,
    /// Number of items that were taken.
    takes: u64,
    /// Held by the lanes with [`Keep::All`].
    held: Limit,
    woken: bool,
    ended: bool,
}

struct Waiting<T> {
    keep: Keep,
    items: VecDeque<WaitingItem<T>>,
    /// Number of the take that was last served from this lane; 0 before the first.
    served: u64,
    counts: LaneCounts,
    gaps: Gaps,
}

struct WaitingItem<T> {
    arrival: u64,
    stamp_ns: u64,
    item: T,
}

impl<T: Queued> Queue<T> {
    /// Creates a queue without lanes, whose arrivals are stamped with the time of `clock`.
    pub fn new(clock: Arc<dyn Clock>, limit: Limit) -> Self {
        let state = State {
            lanes: BTreeMap::new(),
            opened: 0,
            arrivals: 0,
            takes: 0,
            held: Limit { messages: 0, bytes: 0 },
            woken: false,
            ended: false,
        };
        Self { state: Mutex::new(state), changed: Condvar::new(), clock, limit }
    }

    /// Returns a new, empty lane.
    pub fn open(&self, keep: Keep) -> Lane {
        let mut state = self.lock();
        let lane = Lane(state.opened);
        state.opened += 1;
        let (counts, gaps) = (LaneCounts::default(), Gaps::default());
        let waiting = Waiting { keep, items: VecDeque::new(), served: 0, counts, gaps };
        state.lanes.insert(lane, waiting);
        lane
    }

    /// Puts `item` at the end of `lane` and never waits. Returns the item that lost its place: an older one, or `item`
    /// itself when the limit is reached or the lane is closed.
    pub fn push(&self, lane: Lane, item: T) -> Option<T> {
        let mut guard = self.lock();
        let state = &mut *guard;
        // A callback of the transport may run once more after its lane was closed.
        let Some(waiting) = state.lanes.get_mut(&lane).filter(|_| !state.ended) else { return Some(item) };
        waiting.counts.received += 1;
        if let Some(attachment) = item.attachment() {
            let (missing, jumps) = match waiting.gaps.step(attachment) {
                Step::Missing(missing) => (missing, 0),
                Step::Jumped => (1, 1),
            };
            waiting.counts.missing += missing;
            waiting.counts.jumps += jumps;
        }
        let arrival = state.arrivals;
        let displaced = match waiting.keep {
            Keep::All => {
                let bytes = state.held.bytes.saturating_add(item.bytes());
                if state.held.messages >= self.limit.messages || bytes > self.limit.bytes {
                    waiting.counts.overflowed += 1;
                    return Some(item);
                }
                state.held = Limit { messages: state.held.messages + 1, bytes };
                None
            }
            Keep::Latest => waiting.items.pop_front().inspect(|_| waiting.counts.replaced += 1),
            Keep::Last(most) if waiting.items.len() >= most.max(1) => {
                waiting.counts.overflowed += 1;
                waiting.items.pop_front()
            }
            Keep::Last(_) => None,
        };
        waiting.items.push_back(WaitingItem { arrival, stamp_ns: self.clock.now_ns(), item });
        state.arrivals += 1;
        // Released first, or the reader would wake only to wait for the lock.
        drop(guard);
        self.changed.notify_all();
        // Returned and not dropped here: to free an image takes time, and the lock was held.
        displaced.map(|displaced| displaced.item)
    }

    /// Takes the item that arrived first over all lanes. Of the lanes with [`Keep::Latest`] the one goes first from which
    /// nothing was taken for the longest time, so that each of several cameras gets its share of a busy reader. Waits for an
    /// item at most `patience`, or without end when that is `None`. Returns `None` when no item came in time, when
    /// [`Wake::wake`] was called, and when no item waits after [`Queue::end`].
    pub fn take(&self, patience: Option<Duration>) -> Option<Arrived<T>> {
        let state = self.lock();
        let idle = |state: &mut State<T>| {
            !state.woken && !state.ended && state.lanes.values().all(|waiting| waiting.items.is_empty())
        };
        let mut state = match patience {
            Some(patience) => {
                let waited = self.changed.wait_timeout_while(state, patience, idle);
                waited.unwrap_or_else(PoisonError::into_inner).0
            }
            None => self.changed.wait_while(state, idle).unwrap_or_else(PoisonError::into_inner),
        };
        // The wake is used up by this call, even where an item has come as well.
        state.woken = false;
        state.pop_oldest()
    }

    /// Returns the counts of `lane`; zeros once it is closed.
    pub fn counts(&self, lane: Lane) -> LaneCounts {
        let counts = |lane: &Waiting<T>| LaneCounts { unread: lane.items.len() as u64, ..lane.counts };
        self.lock().lanes.get(&lane).map(counts).unwrap_or_default()
    }

    /// Counts what is missing at the end of each publisher of `lane`, where `sent` knows the number of its last message. Returns
    /// what has come of each publisher, by its global id.
    pub fn heard(&self, lane: Lane, sent: impl Fn(&[u8; 16]) -> Option<i64>) -> Vec<([u8; 16], Heard)> {
        let mut state = self.lock();
        let Some(waiting) = state.lanes.get_mut(&lane) else { return Vec::new() };
        waiting.counts.missing += waiting.gaps.end(sent);
        waiting.gaps.heard().map(|(publisher, heard)| (*publisher, *heard)).collect()
    }

    /// Closes `lane` and counts its waiting items as unread. Returns its counts; zeros when it was closed before.
    pub fn close(&self, lane: Lane) -> LaneCounts {
        let mut state = self.lock();
        let Some(mut waiting) = state.lanes.remove(&lane) else { return LaneCounts::default() };
        waiting.counts.unread = waiting.items.len() as u64;
        // Only these lanes share the limit of the queue.
        if waiting.keep == Keep::All {
            waiting.items.iter().for_each(|waiting| state.release(&waiting.item));
        }
        // Released before the items are freed, which takes time where they are images.
        drop(state);
        waiting.counts
    }

    /// Accepts no more items. Waiting items can still be taken; then the reader gets `None` at once.
    pub fn end(&self) {
        self.lock().ended = true;
        self.changed.notify_all();
    }

    /// Locks the state, which is always whole: a poisoned lock means that another thread panicked elsewhere.
    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T: Queued> State<T> {
    fn pop_oldest(&mut self) -> Option<Arrived<T>> {
        // By the number of the arrival: several items may have one stamp.
        let fronts = || self.lanes.iter().filter_map(|(lane, w)| Some((*lane, w, w.items.front()?)));
        let other = fronts().filter(|(_, w, _)| w.keep != Keep::Latest).min_by_key(|(.., item)| item.arrival);
        // Not by the first message since then: of cameras in step, those that send first would be served twice as often.
        let latest = fronts()
            .filter(|(_, w, _)| w.keep == Keep::Latest)
            .min_by_key(|(_, w, item)| (w.served, item.arrival));
        // Keep-latest lanes would starve behind lanes that are never replaced. But a message that describes an image
        // came before it, and must be taken before it.
        let (lane, ..) = match (other, latest) {
            (Some(other), Some(latest)) if latest.2.arrival < other.2.arrival => latest,
            (Some(other), _) => other,
            (None, latest) => latest?,
        };
        let waiting = self.lanes.get_mut(&lane)?;
        let WaitingItem { stamp_ns, item, .. } = waiting.items.pop_front()?;
        self.takes += 1;
        waiting.served = self.takes;
        if waiting.keep == Keep::All {
            self.release(&item);
        }
        Some(Arrived { lane, stamp_ns, item })
    }

    fn release(&mut self, item: &T) {
        self.held.messages -= 1;
        self.held.bytes -= item.bytes();
    }
}

impl<T: Queued + Send> Wake for Queue<T> {
    /// Lets a waiting reader look around; the next [`Queue::take`] does not wait.
    fn wake(&self) {
        self.lock().woken = true;
        self.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use modulo_runtime::{ManualClock, Stop, Urgency};

    const NOW: Option<Duration> = Some(Duration::ZERO);

    impl Queued for usize {
        fn bytes(&self) -> usize {
            *self
        }
    }

    fn queue(messages: usize, bytes: usize) -> Arc<Queue<usize>> {
        Arc::new(Queue::new(Arc::new(ManualClock::at(9)), Limit { messages, bytes }))
    }

    #[test]
    fn the_latest_replaces_and_is_counted() {
        let queue = queue(0, 0);
        let lane = queue.open(Keep::Latest);
        assert_eq!((queue.push(lane, 1), queue.push(lane, 2)), (None, Some(1)));
        assert_eq!(queue.take(NOW), Some(Arrived { lane, stamp_ns: 9, item: 2 }));
        assert_eq!(queue.take(NOW), None);
        assert_eq!(queue.counts(lane), LaneCounts { received: 2, replaced: 1, ..LaneCounts::default() });
    }

    impl Queued for Attachment {
        fn attachment(&self) -> Option<&Attachment> {
            Some(self)
        }
    }

    #[test]
    fn a_jump_of_the_numbers_is_told_and_counts_as_one_loss() {
        let limit = Limit { messages: 9, bytes: 9 };
        let queue = Queue::new(Arc::new(ManualClock::at(9)), limit);
        let lane = queue.open(Keep::All);
        for sequence in [1, 2, 4, i64::MAX, 1, 2] {
            queue.push(lane, Attachment { sequence, stamp_ns: 0, gid: [1; 16], numbers: 1 });
        }
        let counts = queue.close(lane);
        assert_eq!((counts.received, counts.missing, counts.jumps, counts.lost()), (6, 3, 2, 3));
        assert!(
            counts
                .warning("/modulo")
                .is_some_and(|warning| warning.contains("/modulo jumped by more than a million, 2 times"))
        );
        assert_eq!(LaneCounts { jumps: 0, ..counts }.warning("/modulo"), None);
    }

    #[test]
    fn lanes_that_are_replaced_get_their_turn() {
        let queue = queue(1, 1);
        let [front, rear, described] =
            [Keep::Latest, Keep::Latest, Keep::Last(9)].map(|keep| queue.open(keep));
        let mut takes = Vec::new();
        for round in 0..6 {
            // The image of the camera at the rear always comes last, right before the reader is free.
            queue.push(front, round);
            queue.push(described, 100 + round);
            queue.push(rear, 200 + round);
            takes.extend(std::iter::repeat_with(|| queue.take(NOW).expect("three came").item).take(2));
        }
        let images: Vec<_> = takes.iter().copied().filter(|item| !(100..200).contains(item)).collect();
        assert_eq!(images, [0, 201, 2, 203, 4, 205]);
        let position = |item| takes.iter().position(|one| *one == item);
        assert!((0..6).step_by(2).all(|round| position(101 + round) < position(201 + round)), "{takes:?}");
    }

    #[test]
    fn cameras_in_step_share_a_reader_that_is_too_slow_for_all() {
        let queue = queue(0, 0);
        let cameras = [(); 4].map(|()| queue.open(Keep::Latest));
        let mut served = [0; 4];
        for _ in 0..8 {
            for (camera, lane) in cameras.iter().enumerate() {
                queue.push(*lane, camera);
            }
            (0..3).for_each(|_| served[queue.take(NOW).expect("four came").item] += 1);
        }
        assert_eq!(served, [6; 4]);
    }

    #[test]
    fn the_limit_holds_over_all_lanes_and_frees_with_them() {
        let queue = queue(3, 100);
        let [a, b] = [queue.open(Keep::All), queue.open(Keep::All)];
        assert_eq!([queue.push(a, 60), queue.push(b, 60), queue.push(b, 40)], [None, Some(60), None]);
        assert_eq!(queue.close(a), LaneCounts { received: 1, unread: 1, ..LaneCounts::default() });
        assert_eq!(queue.push(a, 1), Some(1), "a closed lane takes no item");
        assert_eq!([queue.push(b, 0), queue.push(b, 0), queue.push(b, 0)], [None, None, Some(0)]);
        assert_eq!(queue.take(NOW).map(|arrived| arrived.item), Some(40));
        let counted = LaneCounts { received: 5, overflowed: 2, unread: 2, ..LaneCounts::default() };
        assert_eq!(queue.close(b), counted);
    }

    /// Notes when it is freed whether the queue is locked.
    struct Probe {
        queue: std::sync::Weak<Queue<Probe>>,
        locked: Arc<Mutex<Option<bool>>>,
    }

    impl Queued for Probe {}

    impl Drop for Probe {
        fn drop(&mut self) {
            let locked = self.queue.upgrade().map(|queue| queue.state.try_lock().is_err());
            *self.locked.lock().expect("no panic") = locked;
        }
    }

    #[test]
    fn items_of_a_closed_lane_are_freed_while_the_queue_is_free() {
        let clock = Arc::new(ManualClock::at(9));
        let queue = Arc::new(Queue::new(clock, Limit { messages: 1, bytes: 0 }));
        let (lane, locked) = (queue.open(Keep::All), Arc::new(Mutex::new(None)));
        queue.push(lane, Probe { queue: Arc::downgrade(&queue), locked: locked.clone() });
        assert_eq!(queue.close(lane).unread, 1);
        assert_eq!(*locked.lock().expect("no panic"), Some(false));
    }

    #[test]
    fn a_reader_wakes_for_an_item_for_a_stop_and_for_the_end() {
        let queue = queue(1, 1);
        let lane = queue.open(Keep::Latest);
        let stop = Stop::default();
        stop.wakes(&queue);
        let reader = std::thread::spawn({
            let queue = queue.clone();
            move || [(); 3].map(|()| queue.take(None).map(|arrived| arrived.item))
        });
        // Each step follows when the reader waits again or is still to come: a wake is kept until then.
        queue.push(lane, 7);
        while !queue.lock().lanes[&lane].items.is_empty() {
            std::thread::yield_now();
        }
        stop.ask(Urgency::Drain);
        while queue.lock().woken {
            std::thread::yield_now();
        }
        queue.end();
        assert_eq!(reader.join().expect("no panic"), [Some(7), None, None]);
        assert_eq!((queue.take(None), queue.push(lane, 8)), (None, Some(8)));
    }

    proptest! {
        #[test]
        fn every_message_is_read_or_counted(
            depth in 1usize..5,
            most in 1usize..9,
            pushes in prop::collection::vec((0usize..3, prop::bool::ANY), 0..60),
        ) {
            let queue = queue(most, usize::MAX);
            let lanes = [Keep::Latest, Keep::Last(depth), Keep::All].map(|keep| queue.open(keep));
            let mut read = Vec::new();
            for (number, (lane, take)) in pushes.iter().enumerate() {
                queue.push(lanes[*lane], number);
                if *take {
                    read.extend(queue.take(NOW).map(|arrived| arrived.item));
                }
            }
            let tallies = lanes.map(|lane| queue.close(lane));
            let received: u64 = tallies.iter().map(|t| t.received).sum();
            let rest: u64 = tallies.iter().map(|t| t.replaced + t.overflowed + t.unread).sum();
            prop_assert_eq!(received, pushes.len() as u64);
            prop_assert_eq!(read.len() as u64 + rest, received);
            prop_assert!(read.is_sorted());
            let state = queue.lock();
            prop_assert_eq!(state.held, Limit { messages: 0, bytes: 0 });
        }
    }
}
