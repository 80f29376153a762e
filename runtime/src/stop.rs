//! How a running node is told to end.

use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};

/// How soon a node should end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Urgency {
    /// Run on.
    None,
    /// Finish what is still on its way from upstream nodes that end as well
    /// (SIGINT, or a launch that is over).
    Drain,
    /// Finish the step at hand (SIGTERM, a second SIGINT).
    Now,
}

/// Something that may wait, and is to look around when a stop is asked for.
pub trait Wake: Send + Sync {
    /// Ends a wait, or the next one if there is none now.
    fn wake(&self);
}

/// A flag shared by everything that should end together. It only ever rises.
#[derive(Clone, Default)]
pub struct Stop(Arc<Shared>);

#[derive(Default)]
struct Shared {
    urgency: AtomicU8,
    waiters: Mutex<Vec<Weak<dyn Wake>>>,
}

impl Stop {
    /// Asks for an end at least this urgent, and wakes everything that waits.
    pub fn ask(&self, urgency: Urgency) {
        self.0.urgency.fetch_max(urgency as u8, Ordering::SeqCst);
        let waiters = self.0.waiters.lock().unwrap_or_else(PoisonError::into_inner).clone();
        waiters.iter().filter_map(Weak::upgrade).for_each(|waiter| waiter.wake());
    }

    /// From now on, `waiter` is woken by [`Stop::ask`], for as long as it lives.
    pub fn wakes<W: Wake + 'static>(&self, waiter: &Arc<W>) {
        let waiter: Arc<dyn Wake> = waiter.clone();
        let mut waiters = self.0.waiters.lock().unwrap_or_else(PoisonError::into_inner);
        waiters.retain(|waiter| waiter.strong_count() > 0);
        waiters.push(Arc::downgrade(&waiter));
    }

    /// The most urgent end that has been asked for.
    pub fn urgency(&self) -> Urgency {
        match self.0.urgency.load(Ordering::SeqCst) {
            0 => Urgency::None,
            1 => Urgency::Drain,
            _ => Urgency::Now,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn urgency_only_rises() {
        let stop = Stop::default();
        assert_eq!(stop.urgency(), Urgency::None);
        stop.ask(Urgency::Now);
        stop.ask(Urgency::Drain);
        assert_eq!(stop.urgency(), Urgency::Now);
    }
}
