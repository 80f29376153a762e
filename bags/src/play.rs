//! [`Player`]: messages of a bag, each with the time when it is due.
//!
//! The caller owns clock and transport: it waits until a message is due and
//! sends the payload as it is.

use std::time::Duration;

use crate::bag::{BagError, BagReader, Messages, RawMessage, Selection};

/// What happens at the end of the bag.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Repeat {
    /// The replay ends.
    #[default]
    Once,
    /// The bag starts again from its first message.
    Forever,
}

/// How a bag is replayed.
#[derive(Clone, Debug, PartialEq)]
pub struct PlayOptions {
    /// Speed: 2 is twice as fast; finite and above 0.
    pub rate: f64,
    /// Bag time that is left out at the start, and at each repetition.
    pub start_offset: Duration,
    /// What happens at the end.
    pub repeat: Repeat,
    /// Names of topics; `None` is all of them.
    pub topics: Option<Vec<String>>,
}

impl Default for PlayOptions {
    fn default() -> Self {
        Self { rate: 1.0, start_offset: Duration::ZERO, repeat: Repeat::Once, topics: None }
    }
}

/// Why a replay is not possible.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlayError {
    /// A rate that is no speed.
    #[error("rate = {rate}: must be a finite number above 0")]
    Rate {
        /// The value that was offered.
        rate: f64,
    },
    /// A start behind the end of the bag.
    #[error("start offset = {offset:?}: the bag lasts {duration:?}")]
    StartOffset {
        /// The value that was offered.
        offset: Duration,
        /// First to last message.
        duration: Duration,
    },
}

/// A message and when to send it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Due {
    /// Since the start of the replay, in real time.
    pub after: Duration,
    /// Topic, log time and payload.
    pub message: RawMessage,
}

/// A bag that is being replayed.
pub struct Player {
    bag: BagReader,
    selection: Selection,
    messages: Messages,
    rate: f64,
    repeat: Repeat,
    /// Log time that stands for the start of a round.
    start: u64,
    /// Bag time of the rounds before this one, ns.
    played: u64,
    /// Bag time of one round, ns.
    round: u64,
    /// Whether this round had a message: one without any is never repeated.
    heard: bool,
}

impl Player {
    /// Prepares the replay of `bag`.
    ///
    /// # Errors
    /// [`PlayError`] for a rate or an offset that is not possible.
    pub fn new(bag: BagReader, options: &PlayOptions) -> Result<Self, PlayError> {
        let rate = options.rate;
        if !rate.is_finite() || rate <= 0.0 {
            return Err(PlayError::Rate { rate });
        }
        let (first, last) = bag.span().unwrap_or_default();
        let offset = u64::try_from(options.start_offset.as_nanos()).unwrap_or(u64::MAX);
        let start = first.checked_add(offset).filter(|&start| start <= last);
        let Some(start) = start else {
            let duration = Duration::from_nanos(last - first);
            return Err(PlayError::StartOffset { offset: options.start_offset, duration });
        };
        let selection = Selection { topics: options.topics.clone(), start_ns: Some(start) };
        let messages = bag.messages(&selection);
        let (repeat, round) = (options.repeat, last - start);
        Ok(Self { bag, selection, messages, rate, repeat, start, played: 0, round, heard: false })
    }

    /// The next message; `None` at the end, and after an error.
    pub fn next_due(&mut self) -> Option<Result<Due, BagError>> {
        loop {
            match self.messages.next() {
                Some(Ok(message)) => {
                    self.heard = true;
                    return Some(Ok(self.due(message)));
                }
                Some(Err(error)) => {
                    self.repeat = Repeat::Once;
                    return Some(Err(error));
                }
                None if self.repeat == Repeat::Once || !self.heard => return None,
                None => {
                    self.heard = false;
                    self.played = self.played.saturating_add(self.round);
                    self.messages = self.bag.messages(&self.selection);
                }
            }
        }
    }

    /// The bag.
    pub fn bag(&self) -> &BagReader {
        &self.bag
    }

    fn due(&self, message: RawMessage) -> Due {
        let bag_time = self.played.saturating_add(message.log_time.saturating_sub(self.start));
        let seconds = bag_time as f64 / 1e9 / self.rate;
        Due { after: Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX), message }
    }
}
