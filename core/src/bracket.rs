//! [`Bracket`]: one radiance of several exposures, as a normal camera makes
//! high dynamic range.
//!
//! The captures follow each other, so that what moves stands at another place in
//! each: the merged image shows it several times. Nothing here aligns or removes
//! these ghosts; it is the baseline whose ghosts are to be measured.

use ndarray::{Array3, Zip};

use crate::frame::Frame;
use crate::range::Range;

/// What the converter's floor takes away on average, code units.
const HALF_A_CODE: f32 = 0.5;

/// The exposure times of a series that covers all of a range.
#[derive(Clone, Debug, PartialEq)]
pub struct Bracket {
    range: Range,
    times: Vec<f32>,
}

/// Captures that cannot be merged.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BracketError {
    /// Another number than that of the exposure times.
    #[error("{found} captures, the bracket has {needed}")]
    Captures {
        /// Given.
        found: usize,
        /// Exposure times.
        needed: usize,
    },
    /// Captures of different shapes.
    #[error("captures of {first:?} and {other:?} (rows, columns, channels), all must be alike")]
    Shapes {
        /// Of the first.
        first: (usize, usize, usize),
        /// Of the one that differs.
        other: (usize, usize, usize),
    },
}

impl Bracket {
    /// `captures` exposure times, at least one, in equal ratios from the shortest, at which the top of `range` just
    /// reaches the peak, to the full one, at which the modulo sensor exposes.
    pub fn new(range: Range, captures: usize) -> Self {
        let last = captures.max(1) - 1;
        let shortest = 1.0 / range.alpha().max(1.0);
        let time = |index: usize| shortest.powf((last - index) as f64 / last.max(1) as f64) as f32;
        Self { range, times: (0..=last).map(time).collect() }
    }

    /// Exposure times in units of the full one, ascending, the last is 1.
    pub fn times(&self) -> &[f32] {
        &self.times
    }

    /// Estimates `x` (H x W x C, code units at the full exposure) from saturated `captures`, one for each of
    /// [`Bracket::times`].
    ///
    /// The mean of `(z + 1/2) / t` with the weights `w(z) t^2` of Robertson, Borman and Stevenson (2003) for a linear
    /// response, where `w` is Debevec and Malik's (1997) hat, 0 at both ends of the codes. A sample that all captures
    /// have at an end is read from the longest that is not saturated, else from the shortest.
    ///
    /// # Errors
    /// [`BracketError`] when a capture is missing or of another shape.
    pub fn merge(&self, captures: &[Frame]) -> Result<Array3<f32>, BracketError> {
        if captures.len() != self.times.len() {
            return Err(BracketError::Captures { found: captures.len(), needed: self.times.len() });
        }
        let first = captures[0].dim();
        if let Some(other) = captures.iter().map(Frame::dim).find(|dim| *dim != first) {
            return Err(BracketError::Shapes { first, other });
        }
        let most = self.range.peak() - 1.0;
        let mut sums: Array3<Sums> = Array3::default(first);
        for (capture, &time) in captures.iter().zip(&self.times) {
            Zip::from(&mut sums).and(&capture.to_f32()).for_each(|sums, &z| sums.add(z, time, most));
        }
        Ok(sums.mapv(|sums| sums.estimate()))
    }
}

/// What the captures so far say of one sample.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    weighted: f32,
    weights: f32,
    /// Of the longest capture that is not saturated, else of the shortest.
    single: f32,
    captures: u32,
}

impl Sums {
    /// Adds code `z` at exposure `time`; times ascend.
    fn add(&mut self, z: f32, time: f32, most: f32) {
        let weight = z.min(most - z).max(0.0);
        self.weighted += weight * time * (z + HALF_A_CODE);
        self.weights += weight * time * time;
        if self.captures == 0 || z < most {
            self.single = (z + HALF_A_CODE) / time;
        }
        self.captures += 1;
    }

    fn estimate(&self) -> f32 {
        if self.weights > 0.0 { self.weighted / self.weights } else { self.single }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{Psf, Sensor, SensorConfig};

    /// One capture of `radiance` for each exposure time of `bracket`.
    fn captures(bracket: &Bracket, radiance: &Array3<f32>) -> Vec<Frame> {
        let expose = |time: &f32| {
            let alpha = bracket.range.alpha() * f64::from(*time);
            let bits = bracket.range.bits();
            let config = SensorConfig { bits, alpha, psf: Psf::None, read_noise: 0.0, shot_noise: 0.0 };
            let sensor = Sensor::new(config).expect("a sensor");
            sensor.expose(radiance.view(), 0).expect("an exposure").saturated()
        };
        bracket.times().iter().map(expose).collect()
    }

    #[test]
    fn times_run_from_the_shortest_to_the_full_one() {
        let times = |alpha, n| Bracket::new(Range::new(8, alpha).unwrap(), n).times().to_vec();
        assert_eq!(times(4.0, 3), [0.25, 0.5, 1.0]);
        assert_eq!(times(16.0, 3), [0.0625, 0.25, 1.0]);
        assert_eq!((times(0.5, 3), times(4.0, 1)), (vec![1.0; 3], vec![1.0]));
    }

    #[test]
    fn captures_that_do_not_fit_are_refused() {
        let bracket = Bracket::new(Range::new(8, 4.0).unwrap(), 2);
        let frame = |width| Frame::from_u8(Array3::zeros((2, width, 3))).unwrap();
        let found = bracket.merge(&[frame(3)]);
        assert_eq!(found, Err(BracketError::Captures { found: 1, needed: 2 }));
        let found = bracket.merge(&[frame(3), frame(4)]);
        assert_eq!(found, Err(BracketError::Shapes { first: (2, 3, 3), other: (2, 4, 3) }));
    }

    #[test]
    fn what_moves_is_there_more_than_once() {
        let bracket = Bracket::new(Range::new(8, 4.0).unwrap(), 3);
        let scene = |place: usize| {
            let mut radiance = Array3::from_elem((1, 3, 1), 0.1);
            radiance[(0, place, 0)] = 0.2;
            radiance
        };
        let moving: Vec<Frame> =
            (0..3).map(|place| captures(&bracket, &scene(place))[place].clone()).collect();
        let x = bracket.merge(&moving).unwrap();
        assert!(x.iter().all(|x| *x > 105.0 && *x < 200.0), "none is plain 102.4 or 204.8: {x}");
    }

    proptest! {
        /// The oracle is the scene: what stands still is found within the step of the longest capture that is not
        /// saturated, whatever the range.
        #[test]
        fn what_stands_still_is_found_to_within_a_step(
            values in prop::collection::vec(0.0f32..1.0, 12),
            alpha in 0.3f64..64.0,
            bits in 4u8..=12,
            n in 1usize..=5,
        ) {
            let range = Range::new(bits, alpha).unwrap();
            let bracket = Bracket::new(range, n);
            let radiance = Array3::from_shape_vec((2, 2, 3), values).unwrap();
            let x = bracket.merge(&captures(&bracket, &radiance)).unwrap();
            let most = range.peak() - 1.0;
            for (&x, &value) in x.iter().zip(&radiance) {
                let truth = value * range.limit() as f32;
                let longest = bracket.times().iter().rev().find(|time| truth * **time < most);
                let Some(time) = longest else { continue };
                // The shorter ones are less exact, and weigh less: with the square of their time.
                let step = 1.0 / time * n as f32;
                prop_assert!((x - truth).abs() <= step * 1.001, "{x} for {truth}, step {step}");
            }
        }
    }
}
