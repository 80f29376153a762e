//! [`Player`]: messages of a bag, each with its place on the timeline of the replay.
//!
//! The caller owns clock and transport: it waits until a message is due and sends the payload as it is.

use std::time::Duration;

use modulo_runtime::clock::nanos;

use crate::bag::{BagError, BagReader, Messages, RawMessage, Selection};

/// The behaviour at the end of the bag.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Repeat {
    /// The replay ends.
    #[default]
    Once,
    /// The bag starts again from its first message.
    Forever,
}

/// The part of a bag that is replayed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PlayOptions {
    /// Bag time that is left out at the start, and at each repetition.
    pub start_offset: Duration,
    /// Bag time that is played; `None` is all of it.
    pub duration: Option<Duration>,
    /// Behaviour at the end of the bag.
    pub repeat: Repeat,
    /// Names of topics; `None` is all of them.
    pub topics: Option<Vec<String>>,
}

/// Error: a replay is not possible.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlayError {
    /// The rate is not finite and positive.
    #[error("rate = {0}: must be a finite number above 0")]
    Rate(f64),
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
pub struct NextMessage {
    /// Position on the timeline of the replay, ns: bag time since its start, rounds one after the other.
    pub position: u64,
    /// Topic, log time and payload.
    pub message: RawMessage,
}

/// A bag that is being replayed.
pub struct Player {
    bag: BagReader,
    selection: Selection,
    messages: Messages,
    repeat: Repeat,
    /// First and last log time of a round.
    window: (u64, u64),
    /// Position at which this round began, ns.
    began: u64,
    /// Whether this round had a message: one without any is never repeated.
    heard: bool,
    left_out: u64,
}

impl Player {
    /// Prepares the replay of `bag`.
    ///
    /// # Errors
    /// [`PlayError::StartOffset`] for an offset behind the end.
    pub fn new(bag: BagReader, options: &PlayOptions) -> Result<Self, PlayError> {
        // An empty bag lasts no time at all.
        let (first, last) = bag.span().unwrap_or((0, 0));
        let start = first.checked_add(nanos(options.start_offset)).filter(|&start| start <= last);
        let Some(start) = start else {
            let duration = Duration::from_nanos(last - first);
            return Err(PlayError::StartOffset { offset: options.start_offset, duration });
        };
        let end = options.duration.map_or(last, |duration| last.min(start.saturating_add(nanos(duration))));
        let selection = Selection { topics: options.topics.clone(), start_ns: Some(start) };
        let messages = bag.messages(&selection);
        let (repeat, window) = (options.repeat, (start, end));
        Ok(Self { bag, selection, messages, repeat, window, began: 0, heard: false, left_out: 0 })
    }

    /// Returns the next message that can be read; `None` at the end, and after an error.
    pub fn next_message(&mut self) -> Option<Result<NextMessage, BagError>> {
        let (start, end) = self.window;
        loop {
            match self.messages.next() {
                Some(Ok(message)) if message.log_time <= end => {
                    self.heard = true;
                    let position = self.began.saturating_add(message.log_time.saturating_sub(start));
                    return Some(Ok(NextMessage { position, message }));
                }
                Some(Err(bad @ BagError::BadMessage { .. })) => {
                    tracing::warn!("{bad}");
                    self.left_out += 1;
                }
                Some(Err(error)) => {
                    self.repeat = Repeat::Once;
                    return Some(Err(error));
                }
                _ if self.repeat == Repeat::Once || !self.heard => return None,
                _ => {
                    self.heard = false;
                    self.began = self.began.saturating_add(end - start);
                    self.messages = self.bag.messages(&self.selection);
                }
            }
        }
    }

    /// Goes on at `log_time`, ns since the epoch; the position of that moment, or `None` when it is not within the
    /// round.
    pub fn seek(&mut self, log_time: u64) -> Option<u64> {
        let (start, end) = self.window;
        if !(start..=end).contains(&log_time) {
            return None;
        }
        let selection = Selection { start_ns: Some(log_time), ..self.selection.clone() };
        self.messages = self.bag.messages(&selection);
        self.began = 0;
        // The rest of this round may be empty, but the next round is not.
        self.heard = true;
        Some(log_time - start)
    }

    /// Returns the bag's time at `position`, ns since the epoch.
    pub fn log_time(&self, position: u64) -> u64 {
        let (start, end) = self.window;
        let round = end - start;
        start
            + match self.repeat {
                Repeat::Forever if round > 0 => position % round,
                _ => position.min(round),
            }
    }

    /// Returns how many single messages could not be read so far.
    pub fn left_out(&self) -> u64 {
        self.left_out
    }

    /// Returns the bag.
    pub fn bag(&self) -> &BagReader {
        &self.bag
    }
}
