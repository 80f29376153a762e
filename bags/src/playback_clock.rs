//! [`PlaybackClock`]: where on its timeline a replay is, given the ticks of a clock.
//!
//! This is pure arithmetic: it reads no clock and does not wait.

use crate::play::PlayError;

/// Whether a replay goes on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlaybackState {
    /// The replay runs.
    #[default]
    Running,
    /// The replay is paused until it is resumed.
    Paused,
}

/// The position of a replay, `anchor.1 + (ticks - anchor.0) * rate` while it runs. Ticks and positions are nanoseconds
/// from an origin of their own.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaybackClock {
    rate: f64,
    state: PlaybackState,
    /// A moment in ticks, and the position then.
    anchor: (u64, u64),
}

impl PlaybackClock {
    /// Position 0 at `ticks`.
    ///
    /// # Errors
    /// [`PlayError::Rate`] for a rate that is not finite and positive.
    pub fn new(ticks: u64, rate: f64, state: PlaybackState) -> Result<Self, PlayError> {
        Ok(Self { rate: check(rate)?, state, anchor: (ticks, 0) })
    }

    /// Returns the position at `ticks`, ns.
    pub fn position(&self, ticks: u64) -> u64 {
        match self.state {
            PlaybackState::Paused => self.anchor.1,
            PlaybackState::Running => {
                let passed = ticks.saturating_sub(self.anchor.0) as f64 * self.rate;
                self.anchor.1.saturating_add(passed as u64)
            }
        }
    }

    /// Returns the ticks at which `position` is reached; `None` while paused.
    pub fn ticks_of(&self, position: u64) -> Option<u64> {
        let ahead = position.saturating_sub(self.anchor.1) as f64 / self.rate;
        // Rounded up: at that tick it is reached, not nearly.
        (self.state == PlaybackState::Running).then(|| self.anchor.0.saturating_add(ahead.ceil() as u64))
    }

    /// Returns the speed; 2 is twice as fast as the recording.
    pub fn rate(&self) -> f64 {
        self.rate
    }

    /// Returns whether it goes on.
    pub fn state(&self) -> PlaybackState {
        self.state
    }

    /// Goes on from `ticks` at another speed.
    ///
    /// # Errors
    /// [`PlayError::Rate`] for a rate that is not finite and positive.
    pub fn set_rate(&mut self, ticks: u64, rate: f64) -> Result<(), PlayError> {
        let rate = check(rate)?;
        self.jump(ticks, self.position(ticks));
        self.rate = rate;
        Ok(())
    }

    /// Stops or goes on at `ticks`.
    pub fn set_state(&mut self, ticks: u64, state: PlaybackState) {
        self.jump(ticks, self.position(ticks));
        self.state = state;
    }

    /// Is at `position` at `ticks`.
    pub fn jump(&mut self, ticks: u64, position: u64) {
        self.anchor = (ticks, position);
    }
}

fn check(rate: f64) -> Result<f64, PlayError> {
    if rate.is_finite() && rate > 0.0 { Ok(rate) } else { Err(PlayError::Rate(rate)) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_position_is_reached_when_it_is_said(rate in 0.01..100.0_f64, ticks in 0..u64::MAX / 4, ahead in 0..1_000_000_000_000_u64) {
            let pace = PlaybackClock::new(ticks, rate, PlaybackState::Running).expect("a rate");
            let at = pace.ticks_of(ahead).expect("running");
            // Below the resolution of f64 and of whole ticks.
            prop_assert!(pace.position(at).abs_diff(ahead) as f64 <= 1.0 + rate + ahead as f64 * 1e-14);
        }
    }

    #[test]
    fn changes_keep_the_position() {
        let mut pace = PlaybackClock::new(1000, 2.0, PlaybackState::Running).expect("a rate");
        assert_eq!((pace.position(1000), pace.position(1100)), (0, 200));
        pace.set_state(1100, PlaybackState::Paused);
        assert_eq!((pace.position(9000), pace.ticks_of(300)), (200, None));
        pace.set_state(9000, PlaybackState::Running);
        pace.set_rate(9100, 0.5).expect("a rate");
        assert_eq!((pace.position(9100), pace.position(9200), pace.ticks_of(500)), (400, 450, Some(9300)));
        assert_eq!(pace.set_rate(9200, 0.0), Err(PlayError::Rate(0.0)));
        assert_eq!(pace.position(9300), 500);
        pace.jump(9300, 7);
        assert_eq!(pace.position(9302), 8);
    }
}
