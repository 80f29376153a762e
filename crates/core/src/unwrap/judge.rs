//! [`Judged`]: a method, and whether its results are to be trusted, whatever method found them.
//!
//! A method says whether its counts agree with each other. The judge then takes the trust from a result whose errors could be
//! undetectable ([`edges`](super::edges)), and looks for evidence of the absolute offset ([`offset`](super::offset)).

use super::edges::{self, Arrangement};
use super::offset::OffsetFinder;
use super::{PROOF, Recovered, Scene, Trust, Unwrap, UnwrapError};
use crate::frame::Frame;

/// A method with its judge.
pub(super) struct Judged {
    method: Box<dyn Unwrap>,
    /// Finds the offset of the results of a sensor with one gain; pixels of low gain show that of two gains.
    offset: Option<OffsetFinder>,
}

impl Judged {
    /// Returns `method` for a sensor with one gain. `successive`: the images are successive frames of one camera.
    pub fn of_one_gain(method: Box<dyn Unwrap>, successive: bool) -> Self {
        Self { method, offset: Some(OffsetFinder::new(successive)) }
    }

    /// Returns `method` for a sensor with two gains.
    pub fn of_two_gains(method: Box<dyn Unwrap>) -> Self {
        Self { method, offset: None }
    }
}

impl Unwrap for Judged {
    fn name(&self) -> &'static str {
        self.method.name()
    }

    fn unwrap(&mut self, y: &Frame, scene: &Scene, out: &mut Recovered) -> Result<(), UnwrapError> {
        self.method.unwrap(y, scene, out)?;
        if out.report.method == PROOF {
            return Ok(());
        }
        let arrangement = match (&self.offset, y.mosaic()) {
            (None, _) => Arrangement::TwoGains,
            (Some(_), Some(_)) => Arrangement::Mosaic,
            (Some(_), None) => Arrangement::Next,
        };
        edges::withhold_trust(y, out, arrangement, scene);
        if let Some(offset) = &mut self.offset {
            offset.settle(y, out, scene.range);
        }
        // What does not contradict itself would not have become better.
        out.report.is_over_budget &= ![Trust::Trusted, Trust::Relative].contains(&out.report.trust);
        Ok(())
    }
}
