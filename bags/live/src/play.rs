//! [`Player`]: messages of a bag, each with its position on the timeline of the replay, and [`PlaybackClock`]: the
//! position of a replay, given the ticks of a clock.
//!
//! The caller owns clock and transport: it waits until a message is due and sends the payload as it is.

use std::time::Duration;

use modulo_bags::bag::{BagError, BagReader, Messages, RawMessage, Selection, TopicCount};
use modulo_runtime::clock::nanos;

/// A shorter part of a bag is not repeated.
const SHORTEST_ROUND: Duration = Duration::from_millis(1);

/// The part of a bag that is replayed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PlayOptions {
    /// Bag time that is left out at the start, and at each repetition.
    pub start_offset: Duration,
    /// Bag time that is played; `None` is all of it.
    pub duration: Option<Duration>,
    /// Whether the bag starts again from its first message when it is over.
    pub repeats: bool,
    /// Names of topics; `None` is all of them.
    pub topics: Option<Vec<String>>,
}

/// Error: a replay is not possible. The text has the option, and what is needed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct PlayError(String);

/// A bag that is being replayed.
pub struct Player {
    /// The bag.
    pub bag: BagReader,
    selection: Selection,
    messages: Messages,
    repeats: bool,
    /// The first and the last log time that are played, ns since the epoch.
    pub window: (u64, u64),
    /// Position at which this round began, ns.
    began: u64,
    /// Whether this round had a message: one without any is never repeated.
    heard: bool,
    /// How many single messages could not be read so far.
    pub left_out: u64,
}

impl Player {
    /// Prepares the replay of `bag`.
    ///
    /// # Errors
    /// [`PlayError`] for an offset behind the end, for a repetition of less than 1 ms, and when no chosen topic is in the bag.
    pub fn new(bag: BagReader, options: &PlayOptions) -> Result<Self, PlayError> {
        check_topics(&bag, options.topics.as_deref().unwrap_or_default())?;
        // An empty bag lasts no time at all.
        let (first, last) = bag.span().unwrap_or((0, 0));
        // An offset to the very end still plays the last message.
        let start = first.checked_add(nanos(options.start_offset)).filter(|&start| start <= last);
        let Some(start) = start else {
            let (offset, lasts) = (options.start_offset, Duration::from_nanos(last - first));
            return Err(PlayError(format!("start offset = {offset:?}: the bag lasts {lasts:?}")));
        };
        let end = options.duration.map_or(last, |duration| last.min(start.saturating_add(nanos(duration))));
        let selection = Selection { topics: options.topics.clone(), start_ns: Some(start) };
        let round = Duration::from_nanos(end - start);
        if options.repeats && round < SHORTEST_ROUND && bag.span().is_some() {
            return Err(PlayError(format!(
                "loop = true: the part of the bag that is played lasts {round:?}, and at least 1 ms is needed; play more of it, or \
                 only once"
            )));
        }
        let messages = bag.messages(&selection);
        let (repeats, window) = (options.repeats, (start, end));
        Ok(Self { bag, selection, messages, repeats, window, began: 0, heard: false, left_out: 0 })
    }

    /// Returns the next message that can be read, behind its position on the timeline of the replay in ns: bag time since its start, rounds one
    /// after the other. `None` at the end, and after an error.
    pub fn next_message(&mut self) -> Option<Result<(u64, RawMessage), BagError>> {
        let (start, end) = self.window;
        loop {
            match self.messages.next() {
                Some(Ok(message)) if message.log_time <= end => {
                    self.heard = true;
                    let position = self.began.saturating_add(message.log_time.saturating_sub(start));
                    return Some(Ok((position, message)));
                }
                Some(Err(BagError::LeftOut(left_out))) => {
                    tracing::warn!("{left_out}");
                    // Where the damage hides their number, it is one at least.
                    self.left_out += left_out.messages.unwrap_or(1);
                }
                Some(Err(error)) => {
                    // The position in the bag is unknown after an error, so it is not repeated.
                    self.repeats = false;
                    return Some(Err(error));
                }
                // A round without any message would repeat for ever without a pause.
                _ if !self.repeats || !self.heard => return None,
                _ => {
                    self.heard = false;
                    self.began = self.began.saturating_add(end - start);
                    self.messages = self.bag.messages(&self.selection);
                }
            }
        }
    }

    /// Goes on at `log_time`, ns since the epoch. Returns its position, or `None` for a time outside of the round.
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
        start + if self.repeats && round > 0 { position % round } else { position.min(round) }
    }

    /// Returns the topics that are played, with their counts in the whole bag.
    pub fn topics(&self) -> Vec<TopicCount> {
        let mut topics = self.bag.topics();
        topics.retain(|counted| self.selection.has(&counted.topic.name));
        topics
    }
}

/// Reports each of the topics `wanted` that the bag does not have.
fn check_topics(bag: &BagReader, wanted: &[String]) -> Result<(), PlayError> {
    let topics = bag.topics();
    let missing: Vec<_> =
        wanted.iter().filter(|name| topics.iter().all(|counted| counted.topic.name != **name)).collect();
    if !missing.is_empty() && missing.len() == wanted.len() {
        let topics: Vec<_> = topics.iter().map(|counted| counted.topic.name.as_str()).collect();
        let topics = if topics.is_empty() { "none".to_owned() } else { topics.join(", ") };
        return Err(PlayError(format!(
            "the bag has none of the topics {}; it has {topics}",
            wanted.join(", ")
        )));
    }
    missing.iter().for_each(|name| tracing::warn!("the bag has no topic '{name}'"));
    Ok(())
}

/// The position of a replay, `anchor.1 + (ticks - anchor.0) * rate` while it runs, in ns; ticks have an origin of their
/// own. At rate 0 no time passes by itself: each message is due at once, and moves the position.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaybackClock {
    rate: f64,
    is_paused: bool,
    /// A moment in ticks, and the position then.
    anchor: (u64, u64),
}

impl PlaybackClock {
    /// Creates a clock that is at position 0 at `ticks`.
    ///
    /// # Errors
    /// [`PlayError`] for a rate that is not a finite number from 0 on.
    pub fn new(ticks: u64, rate: f64, is_paused: bool) -> Result<Self, PlayError> {
        Ok(Self { rate: check(rate)?, is_paused, anchor: (ticks, 0) })
    }

    /// Returns the position at `ticks`, ns.
    pub fn position(&self, ticks: u64) -> u64 {
        let passed = ticks.saturating_sub(self.anchor.0) as f64 * self.rate;
        if self.is_paused { self.anchor.1 } else { self.anchor.1.saturating_add(passed as u64) }
    }

    /// Returns the ticks at which `position` is reached; `None` while paused.
    pub fn ticks_of(&self, position: u64) -> Option<u64> {
        let ahead =
            if self.rate == 0.0 { 0.0 } else { position.saturating_sub(self.anchor.1) as f64 / self.rate };
        // Rounded up: at that tick it is reached, not nearly.
        (!self.is_paused).then(|| self.anchor.0.saturating_add(ahead.ceil() as u64))
    }

    /// Returns the speed; 2 is twice as fast as the recording, 0 as fast as the readers take the images.
    pub fn rate(&self) -> f64 {
        self.rate
    }

    /// Returns whether the replay is paused until it is resumed.
    pub fn is_paused(&self) -> bool {
        self.is_paused
    }

    /// Goes on from `ticks` at another speed.
    ///
    /// # Errors
    /// [`PlayError`] for a rate that is not a finite number from 0 on.
    pub fn set_rate(&mut self, ticks: u64, rate: f64) -> Result<(), PlayError> {
        let rate = check(rate)?;
        // The position so far counts at the old rate; only from here on the new one holds.
        self.jump(ticks, self.position(ticks));
        self.rate = rate;
        Ok(())
    }

    /// Pauses or goes on at `ticks`.
    pub fn set_paused(&mut self, ticks: u64, is_paused: bool) {
        // The time until now belongs to the old state.
        self.jump(ticks, self.position(ticks));
        self.is_paused = is_paused;
    }

    /// Moves the replay to `position` at `ticks`.
    pub fn jump(&mut self, ticks: u64, position: u64) {
        self.anchor = (ticks, position);
    }
}

fn check(rate: f64) -> Result<f64, PlayError> {
    let why = || PlayError(format!("rate = {rate}: must be a finite number, 0 or above"));
    (rate.is_finite() && rate >= 0.0).then_some(rate).ok_or_else(why)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_position_is_reached_when_it_is_said(rate in 0.01..100.0_f64, ticks in 0..u64::MAX / 4, ahead in 0..1_000_000_000_000_u64) {
            let pace = PlaybackClock::new(ticks, rate, false).expect("a rate");
            let at = pace.ticks_of(ahead).expect("running");
            // Below the resolution of f64 and of whole ticks.
            prop_assert!(pace.position(at).abs_diff(ahead) as f64 <= 1.0 + rate + ahead as f64 * 1e-14);
        }
    }

    #[test]
    fn changes_keep_the_position() {
        let mut pace = PlaybackClock::new(1000, 2.0, false).expect("a rate");
        assert_eq!((pace.position(1000), pace.position(1100)), (0, 200));
        pace.set_paused(1100, true);
        assert_eq!((pace.position(9000), pace.ticks_of(300)), (200, None));
        pace.set_paused(9000, false);
        pace.set_rate(9100, 0.5).expect("a rate");
        assert_eq!((pace.position(9100), pace.position(9200), pace.ticks_of(500)), (400, 450, Some(9300)));
        assert!(pace.set_rate(9200, -0.5).is_err_and(|why| why.to_string().starts_with("rate = -0.5: ")));
        assert_eq!(pace.position(9300), 500);
        pace.jump(9300, 7);
        assert_eq!(pace.position(9302), 8);
        pace.set_rate(9302, 0.0).expect("a rate");
        assert_eq!((pace.position(9900), pace.ticks_of(500)), (8, Some(9302)), "each message is due at once");
    }
}
