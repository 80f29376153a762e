//! [`Stop`]: the request to end that everything in a process shares.

use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use nix::sys::signal::Signal;

/// The urgency of a request to end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Urgency {
    /// No end is requested.
    None,
    /// The node is to finish the messages that are still on their way from upstream nodes which end as well (SIGINT, or
    /// a launch that is over).
    Drain,
    /// Finish the step at hand (SIGTERM, SIGHUP, a second SIGINT).
    Now,
}

/// Something that may wait, and is to look around when a stop is asked for.
pub trait Wake: Send + Sync {
    /// Ends the current wait, or the next one.
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
        // Waiters are woken without this lock, since they take locks of their own.
        let waiters = self.0.waiters.lock().unwrap_or_else(PoisonError::into_inner).clone();
        waiters.iter().filter_map(Weak::upgrade).for_each(|waiter| waiter.wake());
    }

    /// Makes [`Stop::ask`] wake `waiter` for as long as it lives.
    pub fn wakes<W: Wake + 'static>(&self, waiter: &Arc<W>) {
        let waiter: Arc<dyn Wake> = waiter.clone();
        let mut waiters = self.0.waiters.lock().unwrap_or_else(PoisonError::into_inner);
        // Queues that are gone leave their entries behind.
        waiters.retain(|waiter| waiter.strong_count() > 0);
        waiters.push(Arc::downgrade(&waiter));
    }

    /// Returns the most urgent end that has been asked for.
    pub fn urgency(&self) -> Urgency {
        match self.0.urgency.load(Ordering::SeqCst) {
            0 => Urgency::None,
            1 => Urgency::Drain,
            _ => Urgency::Now,
        }
    }
}

/// Returns whether this process ignores SIGHUP, which a terminal sends when it is closed.
pub fn is_hangup_ignored() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    // Bit n stands for signal n + 1.
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    ignored.is_some_and(|mask| mask & (1 << (Signal::SIGHUP as u32 - 1)) != 0)
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
