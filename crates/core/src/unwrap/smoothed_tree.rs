//! Smoothed tree: `gradient_tree` on a modulo image without most of its noise, for frames in which noise makes differences wrap.
//!
//! With the smoothed codes s of [`Smoothing`], and their result `s + k_s 2^b`, the radiance is `s + k_s 2^b + M_b(y - s)`, which is congruent
//! with y. It is exact where the noise of y is below half a peak and `gradient_tree` is exact on s.

use super::budget::{self, Budget};
use super::growth::Growth;
use super::smoothing::{Smoothing, noise};
use super::{GROWTH, GradientTree, Integers, Range, Recovered, SMOOTHED_TREE, UnwrapError};
use crate::frame::Frame;
use crate::simd::widest;

/// The method with its buffers. Codes have a peak of 2^16.
#[derive(Default)]
pub(super) struct SmoothedTree {
    smoothing: Smoothing,
    codes: Vec<u16>,
    noise: f32,
    smoothed: Vec<u16>,
    growth: Growth,
    /// The result for the smoothed codes.
    smooth: Recovered,
}

impl SmoothedTree {
    /// Reads `y`, and returns the standard deviation of its noise in peaks, at most 0.19.
    ///
    /// # Errors
    /// Those of [`Unwrap::unwrap`](super::Unwrap::unwrap).
    pub fn read(&mut self, y: &Frame, range: Range) -> Result<f32, UnwrapError> {
        let shift = 16 - range.bits();
        Integers::checked(y, range)?.widen(&mut self.codes);
        widest!(self.codes.iter_mut().for_each(|code| *code <<= shift));
        self.noise = noise(&self.codes, y.dim());
        Ok(self.noise / (u32::from(u16::MAX) + 1) as f32)
    }

    /// Returns the work of the tree on the codes of `dim` that were read.
    pub fn work_of_tree(&self, dim: (usize, usize, usize)) -> f64 {
        budget::of_tree(&self.codes, dim)
    }

    /// Unwraps the image of `dim` that was read, by `tree` on smoothed codes; returns whether the work was left.
    pub fn unwrap(
        &mut self,
        tree: &mut GradientTree,
        dim: (usize, usize, usize),
        (range, outliers): (Range, f64),
        left: &mut Budget,
        out: &mut Recovered,
    ) -> bool {
        let Self { smoothing, codes, noise, smoothed, smooth, .. } = self;
        if !left.take(budget::SMOOTHING * codes.len() as f64) {
            return false;
        }
        smoothing.apply(codes, dim, *noise, smoothed);
        if !left.take(budget::of_tree(smoothed, dim)) {
            return false;
        }
        // The tree reads codes of the range; the last half of a code rounds up to the next peak.
        let shift = 16 - range.bits();
        let half = (1 << shift) >> 1;
        smoothed.iter_mut().for_each(|code| *code = code.wrapping_add(half) >> shift);
        smooth.prepare(dim, SMOOTHED_TREE);
        tree.unwrap_codes(Integers::U16(smoothed), dim, range, outliers, smooth);
        self.lift(SMOOTHED_TREE, range, out);
        true
    }

    /// Takes a result for the codes that were read as the one to grow from.
    pub fn take(&mut self, result: &Recovered) {
        self.smooth.x.clone_from(&result.x);
    }

    /// Writes the last result of `tree` anew, at the offset that so many outliers allow.
    pub fn place(&mut self, tree: &mut GradientTree, range: Range, outliers: f64, out: &mut Recovered) {
        tree.place(Integers::U16(&self.smoothed), range, outliers, &mut self.smooth);
        self.lift(SMOOTHED_TREE, range, out);
    }

    /// Grows the last result from its largest part without a contradiction, if it can be predicted; returns whether it can, and `None` if the
    /// work was not left. So many `outliers` of the part may be below its least count.
    pub fn grow(
        &mut self,
        range: Range,
        outliers: f64,
        left: &mut Budget,
        out: &mut Recovered,
    ) -> Option<bool> {
        let (height, width, _) = self.smooth.x.dim();
        let pixels = (height * width) as f64;
        if !left.take(budget::FIND_PART * pixels) {
            return None;
        }
        let Some(share) = self.growth.read(&self.smooth.x, range) else { return Some(false) };
        if !left.take(budget::GROWTH * (1.0 - share) * pixels) {
            return None;
        }
        self.growth.grow(&mut self.smooth.x, range, outliers);
        self.lift(GROWTH, range, out);
        Some(true)
    }

    /// Writes the radiance that is congruent with the codes and nearest to the result for the smoothed ones.
    fn lift(&self, method: &'static str, range: Range, out: &mut Recovered) {
        let (shift, most, peak) = (16 - range.bits(), i32::from(range.max_wraps()), range.peak());
        let smooth = self.smooth.x.as_slice().expect("prepare has made the layout standard");
        out.prepare(self.smooth.x.dim(), method);
        let (x, k) = out.buffers();
        widest!(for (((x, k), code), smooth) in x.iter_mut().zip(k).zip(&self.codes).zip(smooth) {
            let smooth = (*smooth as i32) << shift;
            let change = i32::from(code.wrapping_sub(smooth as u16).cast_signed());
            *k = ((smooth + change) >> 16).clamp(0, most) as u8;
            *x = f32::from(code >> shift) + f32::from(*k) * peak;
        });
    }
}
