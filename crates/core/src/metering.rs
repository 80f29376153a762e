//! [`Metering`]: how bright an image is, and the exposure that it asks for.

use ndarray::{ArrayRef3, Axis};

use crate::range::Range;

/// The pixels of an image that decide its exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Metering {
    /// The mean of all pixels.
    #[default]
    Mean,
    /// The mean of all pixels, in which those of the middle half of the rows and of the columns count three times.
    Centre,
    /// The brightest pixels: 99.9 % of the samples shall lie below 0.95 of the largest code.
    Highlights,
}

impl Metering {
    /// Every metering with its word.
    pub const WORDS: [(&'static str, Self); 3] =
        [("mean", Self::Mean), ("centre", Self::Centre), ("highlights", Self::Highlights)];
}

/// The weight of the middle of the image in [`Metering::Centre`].
const CENTRE_WEIGHT: u64 = 3;

/// The share of the samples that may be brighter than the goal of [`Metering::Highlights`], and this goal as a fraction of the largest code.
const HIGHLIGHTS: f64 = 1e-3;
const HIGHLIGHT_GOAL: f64 = 0.95;

/// The most levels of radiance that are told apart.
const LEVELS: usize = 1 << 14;

/// The radiance of the samples of an image.
pub(crate) struct Levels {
    metering: Metering,
    /// The weights of the samples of each level, from 0 to the largest.
    weights: Vec<u64>,
}

impl Levels {
    /// Counts the samples of `x`, H x W x C in code units, whose largest level is that of `most`.
    pub fn of(x: &ArrayRef3<f32>, most: f32, metering: Metering) -> Self {
        let scale = (most / LEVELS as f32).max(1.0);
        let mut weights = vec![0; (most / scale) as usize + 1];
        let last = weights.len() - 1;
        let (height, width, _) = x.dim();
        let middle = |at: usize, side: usize| (side / 4..side - side / 4).contains(&at);
        for (row, line) in x.axis_iter(Axis(0)).enumerate() {
            for (column, pixel) in line.axis_iter(Axis(0)).enumerate() {
                let is_middle = metering == Metering::Centre && middle(row, height) && middle(column, width);
                let weight = if is_middle { CENTRE_WEIGHT } else { 1 };
                // `as` sends NaN and negative numbers to 0.
                pixel.iter().for_each(|x| weights[((x / scale) as usize).min(last)] += weight);
            }
        }
        Self { metering, weights }
    }

    /// Returns the factor between the exposure of this image and the one that it asks for; a mean shall be `goal` of the largest level. `None` for a
    /// black image.
    pub fn ratio(&self, goal: f64) -> Option<f64> {
        let ratio = match self.metering {
            Metering::Mean | Metering::Centre => goal / self.mean(1.0),
            Metering::Highlights => HIGHLIGHT_GOAL / self.highlight(),
        };
        Some(ratio).filter(|ratio| ratio.is_finite())
    }

    /// Returns the largest level.
    fn most(&self) -> f64 {
        (self.weights.len() - 1).max(1) as f64
    }

    /// Returns the mean of `gain` times the samples, each at most the largest level, as a fraction of it.
    fn mean(&self, gain: f64) -> f64 {
        let levels = (0..)
            .zip(&self.weights)
            .map(|(level, &weight)| (gain * f64::from(level)).min(self.most()) * weight as f64);
        levels.sum::<f64>() / self.weights.iter().sum::<u64>() as f64 / self.most()
    }

    /// Returns the least level above which at most [`HIGHLIGHTS`] of the samples lie, as a fraction of the largest one. If more have the largest
    /// one, nobody knows how bright they are; twice as bright is assumed.
    fn highlight(&self) -> f64 {
        let mut left = (HIGHLIGHTS * self.weights.iter().sum::<u64>() as f64) as u64;
        let level = (0..self.weights.len()).rev().find(|&level| {
            let is_within = self.weights[level] <= left;
            left = left.saturating_sub(self.weights[level]);
            !is_within
        });
        match level.unwrap_or(0) as f64 {
            level if level == self.most() => 2.0,
            level => level / self.most(),
        }
    }

    /// Returns the gain, at least 1, with which the image is as bright as `goal`: the mean of the samples, clipped after the gain, is the goal.
    fn gain(&self, goal: f64) -> f64 {
        if self.metering == Metering::Highlights {
            return self.ratio(goal).map_or(self.most(), |ratio| ratio.max(1.0));
        }
        let (mut low, mut high) = (1.0, self.most());
        // Each step halves the interval of the logarithm, which is 10 at most.
        for _ in 0..16 {
            let middle = f64::sqrt(low * high);
            if self.mean(middle) < goal { low = middle } else { high = middle }
        }
        low
    }
}

/// Returns the range whose white is shown as white where the recovered radiance `x` (H x W x C, code units) is exposed anew, after it was
/// captured: the level that `metering` looks at is `target` of the radiance of white. What is brighter than its white clips, as in
/// a camera with automatic exposure, but there is no delay.
pub fn exposed_anew(x: &ArrayRef3<f32>, range: Range, metering: Metering, target: f64) -> Range {
    let gain = Levels::of(x, range.white() as f32, metering).gain(target);
    let headroom = range.white() / range.limit() / gain;
    range.with_headroom(headroom).expect("a gain from 1 to 2^14 leaves a headroom above 0 and at most 1")
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::tone;
    use crate::transfer::Transfer;

    #[test]
    fn a_dark_scene_is_shown_as_bright_as_the_target_and_a_bright_one_as_it_is() {
        let range = Range::new(8, 4.0).unwrap();
        for metering in [Metering::Mean, Metering::Centre] {
            for transfer in [Transfer::Linear, Transfer::Srgb] {
                for (brightest, is_dark) in [(60.0, true), (300.0, true), (1023.0, false)] {
                    let x = Array3::from_shape_fn((32, 64, 3), |(i, j, c)| {
                        (brightest * ((i * 64 + j + c) % 97) as f32 / 97.0).floor()
                    });
                    let shown = exposed_anew(&x, range, metering, 0.3);
                    let picture = tone::picture(&x, shown, transfer).unwrap().to_f32();
                    let mean = picture.mapv(|code| transfer.decode(f64::from(code) / 255.0)).mean().unwrap();
                    assert!(!is_dark || (mean - 0.3).abs() < 0.02, "{transfer:?} {brightest}: {mean}");
                    assert!(is_dark || shown == range);
                }
            }
        }
    }

    #[test]
    fn highlights_are_kept_below_white_and_black_stays_black() {
        let range = Range::new(8, 4.0).unwrap();
        let x = Array3::from_shape_fn((50, 50, 1), |(i, j, _)| if (i, j) == (3, 3) { 900.0 } else { 90.0 });
        let shown = exposed_anew(&x, range, Metering::Highlights, 0.3);
        let white = 90.0 / 0.95;
        assert!((shown.white() - white).abs() < 2.0, "one pixel in 2,500 may clip: {}", shown.white());
        let black = Array3::zeros((8, 8, 1));
        for (_, metering) in Metering::WORDS {
            let shown = exposed_anew(&black, range, metering, 0.3);
            assert!(
                tone::picture(&black, shown, Transfer::Linear).unwrap().to_f32().iter().all(|&x| x == 0.0)
            );
        }
    }
}
