//! [`TrustedExposure`]: the saturation factor of a modulo sensor, which is its exposure, as large as the unwrapper trusts its frames.
//!
//! Radiance is `headroom alpha 2^b` times that of the scene: a larger alpha collects more light and wraps more often. Alpha rises by 10 %
//! after frames in a row that are trusted, and falls by 20 % at once at one that is not. A rise ends 10 % below the value at which trust was lost, for
//! 100 frames, so that alpha does not go up and down without end.

use modulo_msgs::std_msgs::Time;

/// The factors by which alpha rises and falls.
const UP: f64 = 1.1;
const DOWN: f64 = 0.8;

/// The trusted frames in a row after which alpha rises.
const IN_A_ROW: u32 = 5;

/// The frames for which alpha keeps its distance from the value at which trust was lost.
const MEMORY: u32 = 100;

/// The least alpha: nothing wraps.
const LEAST: f64 = 1.0;

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TrustedExposure {
    /// The alpha of the next frame.
    pub alpha: f64,
    /// The largest possible alpha.
    most: f64,
    /// The alpha at which trust was lost, and the frames since then.
    lost: Option<(f64, u32)>,
    trusted: u32,
    /// The stamp of the first frame of this alpha; `None` before it was exposed.
    since: Option<Time>,
}

impl TrustedExposure {
    /// Starts at `alpha`, which never becomes more than `most`.
    pub fn new(alpha: f64, most: f64) -> Self {
        Self { alpha: alpha.min(most), most, lost: None, trusted: 0, since: None }
    }

    pub fn exposed(&mut self, stamp: Time) {
        self.since.get_or_insert(stamp);
    }

    /// Notes whether the frame of `stamp` is trusted; returns whether alpha has changed. Frames of an earlier alpha say nothing.
    pub fn note(&mut self, stamp: Time, is_trusted: bool) -> bool {
        if self.since.is_none_or(|since| stamp.as_ns() < since.as_ns()) {
            return false;
        }
        self.lost = self.lost.map(|(alpha, frames)| (alpha, frames + 1)).filter(|lost| lost.1 < MEMORY);
        if !is_trusted {
            (self.lost, self.trusted) = (Some((self.alpha, 0)), 0);
            return self.set(self.alpha * DOWN);
        }
        self.trusted += 1;
        let next = self.alpha * UP;
        let is_forbidden = self.lost.is_some_and(|(alpha, _)| next * UP > alpha);
        self.trusted >= IN_A_ROW && !is_forbidden && self.set(next)
    }

    fn set(&mut self, alpha: f64) -> bool {
        let alpha = alpha.clamp(LEAST.min(self.most), self.most);
        let is_changed = alpha != self.alpha;
        if is_changed {
            (self.alpha, self.trusted, self.since) = (alpha, 0, None);
        }
        is_changed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs so many frames that are trusted up to `limit`; returns the alpha of each.
    fn run(control: &mut TrustedExposure, frames: u64, limit: f64) -> Vec<f64> {
        (0..frames)
            .map(|frame| {
                let (stamp, alpha) = (Time::from_ns(frame), control.alpha);
                control.exposed(stamp);
                control.note(stamp, alpha <= limit);
                alpha
            })
            .collect()
    }

    #[test]
    fn alpha_stays_just_below_where_trust_is_lost() {
        let alphas = run(&mut TrustedExposure::new(2.0, 8.0), 400, 5.0);
        let untrusted = alphas.iter().filter(|alpha| **alpha > 5.0).count();
        assert!(untrusted <= 5, "one frame a while: {untrusted}");
        assert!(alphas[100..].iter().all(|alpha| (3.5..5.6).contains(alpha)), "{alphas:?}");
    }

    #[test]
    fn a_frame_that_is_not_trusted_ends_a_row_at_the_least_alpha_as_well() {
        let mut control = TrustedExposure::new(1.0, 8.0);
        // Long enough for the distance to the lost value to be forgotten.
        for frame in 0..1000 {
            control.exposed(Time::from_ns(frame));
            let is_trusted = frame % 4 > 0;
            assert!(!control.note(Time::from_ns(frame), is_trusted), "three in a row, frame {frame}");
        }
    }

    #[test]
    fn alpha_has_its_limits() {
        assert_eq!(run(&mut TrustedExposure::new(2.0, 4.0), 100, 100.0).last(), Some(&4.0));
        assert_eq!(run(&mut TrustedExposure::new(2.0, 4.0), 100, 0.0).last(), Some(&1.0));
    }

    #[test]
    fn frames_of_an_earlier_alpha_say_nothing() {
        let mut control = TrustedExposure::new(4.0, 8.0);
        assert!(!control.note(Time::from_ns(1), false), "nothing was exposed");
        control.exposed(Time::from_ns(2));
        assert!(control.note(Time::from_ns(2), false));
        assert!(!control.note(Time::from_ns(3), false), "exposed before the change");
        control.exposed(Time::from_ns(4));
        assert!(!control.note(Time::from_ns(3), false) && control.note(Time::from_ns(4), false));
    }
}
