//! [`Bracket`]: high dynamic range from several exposures, as a normal camera makes it.
//!
//! The captures follow each other in time, so a moving object is at another position in each and appears several times
//! in the merged image. These ghosts are neither aligned nor removed: this is the baseline whose ghosts are measured.

use anyhow::ensure;
use modulo_core::{Frame, Range};
use ndarray::{Array3, Zip};

/// A code stands for its middle.
const HALF_A_CODE: f32 = 0.5;

/// A series of exposure times that covers all of a range.
#[derive(Clone, Debug, PartialEq)]
pub struct Bracket {
    range: Range,
    times: Vec<f32>,
}

impl Bracket {
    /// Makes a series of `captures` exposure times, at least one, in equal ratios. At the shortest, the top of
    /// `range` just reaches the peak; the longest is that of the modulo sensor.
    pub fn new(range: Range, captures: usize) -> Self {
        // A series of one capture is that of the sensor itself.
        let last = captures.max(1) - 1;
        // With alpha below 1 nothing saturates even at the longest exposure.
        let shortest = 1.0 / range.alpha().max(1.0);
        let time = |index: usize| shortest.powf((last - index) as f64 / last.max(1) as f64) as f32;
        Self { range, times: (0..=last).map(time).collect() }
    }

    /// Returns the exposure times in units of the longest, in ascending order; the last is 1.
    pub fn times(&self) -> &[f32] {
        &self.times
    }

    /// Estimates `x` (H x W x C, code units at the longest exposure) from saturated `captures`, one for each of
    /// [`Bracket::times`].
    ///
    /// The estimate is the mean of `(z + 1/2) / t` with the weights `w(z) t^2` of Robertson, Borman and Stevenson
    /// (2003) for a linear response. `w` is the hat function of Debevec and Malik (1997), which is 0 at both ends
    /// of the codes. A sample that is at an end in all captures is read from the longest capture that is not
    /// saturated, else from the shortest.
    ///
    /// # Errors
    /// When a capture is missing or has another shape.
    pub fn merge(&self, captures: &[Frame]) -> anyhow::Result<Array3<f32>> {
        let (count, needed) = (captures.len(), self.times.len());
        ensure!(count == needed, "{count} captures, the bracket has {needed}");
        let first = captures[0].dim();
        if let Some(other) = captures.iter().map(Frame::dim).find(|dim| *dim != first) {
            anyhow::bail!("captures differ in (rows, columns, channels): {first:?} and {other:?}");
        }
        // The highest code also stands for everything brighter, so a sample at it may be saturated.
        let most = self.range.peak() - 1.0;
        let mut sums: Array3<Sums> = Array3::default(first);
        // One capture at a time is turned into floats, so that memory does not grow with their number.
        for (capture, &time) in captures.iter().zip(&self.times) {
            Zip::from(&mut sums).and(&capture.to_f32()).for_each(|sums, &z| sums.add(z, time, most));
        }
        Ok(sums.mapv(|sums| sums.estimate()))
    }
}

/// The sums over the captures of one sample.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    weighted: f32,
    weights: f32,
    /// The estimate from the longest capture that is not saturated, else from the shortest.
    single: f32,
    captures: u32,
}

impl Sums {
    /// Adds code `z` at exposure `time`; exposure times must ascend.
    fn add(&mut self, z: f32, time: f32, most: f32) {
        // Dark codes are mostly rounding error and bright ones may be saturated: neither end has a weight.
        let weight = z.min(most - z).max(0.0);
        // The variance of z / t is proportional to 1 / t^2, so its weight has a factor t^2.
        self.weighted += weight * time * (z + HALF_A_CODE);
        self.weights += weight * time * time;
        // Times ascend, so the last capture that is not saturated is the longest one.
        if self.captures == 0 || z < most {
            self.single = (z + HALF_A_CODE) / time;
        }
        self.captures += 1;
    }

    fn estimate(&self) -> f32 {
        // All weights are 0 where every capture is at an end of the codes, and the quotient would be NaN.
        if self.weights > 0.0 { self.weighted / self.weights } else { self.single }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use modulo_core::{Sensor, SensorConfig};

    /// Returns one capture of `radiance` for each exposure time of `bracket`.
    fn captures(bracket: &Bracket, radiance: &Array3<f32>) -> Vec<Frame> {
        let expose = |time: &f32| {
            let alpha = bracket.range.alpha() * f64::from(*time);
            let bits = bracket.range.bits();
            let config = SensorConfig { bits, alpha, ..SensorConfig::default() };
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
        let why = |captures: &[Frame]| bracket.merge(captures).expect_err("refused").to_string();
        assert_eq!(why(&[frame(3)]), "1 captures, the bracket has 2");
        assert!(why(&[frame(3), frame(4)]).ends_with("(2, 3, 3) and (2, 4, 3)"));
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
        /// The scene itself is the oracle: at any range, a still scene is found within the step of the longest
        /// capture that is not saturated.
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
