//! [`Inbox`]: where messages wait for a step. Images wait in a slot of one (the
//! newest replaces the older), results in a bounded queue; both count what they
//! lose, and nothing ever waits for a slow node.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How many messages wait, and which goes when there is no room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// The newest alone.
    Latest,
    /// The newest `n`.
    Last(usize),
}

/// Counts of one slot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Messages that arrived.
    pub received: u64,
    /// Messages replaced before a step took them.
    pub dropped: u64,
}

/// What a bounded wait ended with.
#[derive(Debug, PartialEq, Eq)]
pub enum Taken<T> {
    /// The oldest waiting message and the slot it came in.
    Item(usize, T),
    /// Nothing came in time.
    Nothing,
}

/// Waiting messages of one node, a slot an input.
#[derive(Debug)]
pub struct Inbox<T> {
    slots: Mutex<State<T>>,
    changed: Condvar,
}

#[derive(Debug)]
struct State<T> {
    slots: Vec<Slot<T>>,
    arrivals: u64,
}

#[derive(Debug)]
struct Slot<T> {
    keep: Keep,
    waiting: VecDeque<(u64, T)>,
    tally: Tally,
}

impl<T> Inbox<T> {
    /// An empty inbox with one slot for each entry of `keep`.
    pub fn new(keep: &[Keep]) -> Self {
        let slots = keep
            .iter()
            .map(|&keep| Slot { keep, waiting: VecDeque::new(), tally: Tally::default() })
            .collect();
        Self { slots: Mutex::new(State { slots, arrivals: 0 }), changed: Condvar::new() }
    }

    /// Puts `item` into slot `slot`; returns whether an older one was dropped.
    /// A slot that does not exist takes nothing.
    pub fn push(&self, slot: usize, item: T) -> bool {
        let mut state = self.lock();
        let arrival = state.arrivals;
        state.arrivals += 1;
        let Some(slot) = state.slots.get_mut(slot) else { return false };
        slot.tally.received += 1;
        let room = match slot.keep {
            Keep::Latest => 1,
            Keep::Last(n) => n.max(1),
        };
        let dropped = slot.waiting.len() >= room;
        if dropped {
            slot.waiting.pop_front();
            slot.tally.dropped += 1;
        }
        slot.waiting.push_back((arrival, item));
        drop(state);
        self.changed.notify_one();
        dropped
    }

    /// Takes the message that came first over all slots, waiting at most
    /// `patience` for one.
    pub fn take(&self, patience: Duration) -> Taken<T> {
        let state = self.lock();
        let empty = |state: &mut State<T>| state.slots.iter().all(|s| s.waiting.is_empty());
        let (mut state, _) =
            self.changed.wait_timeout_while(state, patience, empty).unwrap_or_else(PoisonError::into_inner);
        let oldest = (0..state.slots.len())
            .filter_map(|i| state.slots[i].waiting.front().map(|(arrival, _)| (*arrival, i)))
            .min();
        match oldest.and_then(|(_, i)| state.slots[i].waiting.pop_front().map(|(_, item)| (i, item))) {
            Some((slot, item)) => Taken::Item(slot, item),
            None => Taken::Nothing,
        }
    }

    /// Counts of slot `slot`.
    pub fn tally(&self, slot: usize) -> Tally {
        self.lock().slots.get(slot).map(|s| s.tally).unwrap_or_default()
    }

    /// A poisoned lock only means that another thread panicked elsewhere: the
    /// queues themselves are always whole.
    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.slots.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn latest_replaces_and_counts() {
        let inbox = Inbox::new(&[Keep::Latest]);
        assert!(!inbox.push(0, 1));
        assert!(inbox.push(0, 2));
        assert_eq!(inbox.take(Duration::ZERO), Taken::Item(0, 2));
        assert_eq!(inbox.take(Duration::ZERO), Taken::Nothing);
        assert_eq!(inbox.tally(0), Tally { received: 2, dropped: 1 });
    }

    #[test]
    fn a_waiting_take_wakes_on_push() {
        let inbox = std::sync::Arc::new(Inbox::new(&[Keep::Latest]));
        let waiting = std::thread::spawn({
            let inbox = inbox.clone();
            move || inbox.take(Duration::from_secs(60))
        });
        inbox.push(0, 7);
        assert_eq!(waiting.join().expect("no panic"), Taken::Item(0, 7));
    }

    proptest! {
        /// Received = taken + dropped, and what is taken comes in order of arrival.
        #[test]
        fn every_message_is_taken_or_counted(
            depth in 1usize..5,
            pushes in prop::collection::vec((0usize..2, prop::bool::ANY), 0..60),
        ) {
            let inbox = Inbox::new(&[Keep::Latest, Keep::Last(depth)]);
            let mut taken = Vec::new();
            for (number, (slot, take)) in pushes.iter().enumerate() {
                inbox.push(*slot, number);
                if *take && let Taken::Item(_, item) = inbox.take(Duration::ZERO) {
                    taken.push(item);
                }
            }
            while let Taken::Item(_, item) = inbox.take(Duration::ZERO) {
                taken.push(item);
            }
            let dropped: u64 = (0..2).map(|s| inbox.tally(s).dropped).sum();
            prop_assert_eq!(taken.len() as u64 + dropped, pushes.len() as u64);
            prop_assert!(taken.is_sorted());
        }
    }
}
