//! How a running node is told to end.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

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

/// A flag shared by everything that should end together. It only ever rises.
#[derive(Clone, Debug, Default)]
pub struct Stop(Arc<AtomicU8>);

impl Stop {
    /// Asks for an end at least this urgent.
    pub fn ask(&self, urgency: Urgency) {
        self.0.fetch_max(urgency as u8, Ordering::Relaxed);
    }

    /// What has been asked for.
    pub fn urgency(&self) -> Urgency {
        match self.0.load(Ordering::Relaxed) {
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
