//! [`Budget`]: the work that `auto` may do on one frame.
//!
//! Work is counted before it is done, from what is known of the frame: its pixels, and those whose second differences wrap. The clock is never
//! read, so that a frame has the same result on every machine and under every load. A candidate whose work is not left is not tried.
//!
//! The unit is the time of the work on one core of a server of 2023 (x86-64 with AVX-512), in ns. The constants are measured, by `modulo unwrap` in
//! its release build: on frames of KITTI behind lenses of 0 to 1.4 px at alpha 2 to 8, on a raw HDR mosaic at 11 to 13 bits, and on images of noise of
//! 1920 x 1024 pixels.

use crate::simd::widest;

/// The work of `lines` per sample.
pub(super) const LINES: f64 = 2.0;
/// The work of a proof per sample, and where samples contradict others.
pub(super) const PROOF: f64 = 15.0;
pub(super) const DEFECTS: f64 = 80.0;
/// The work of smoothing, and of SPUD, per sample.
pub(super) const SMOOTHING: f64 = 8.0;
pub(super) const SPUD: f64 = 10.0;
/// The work to find the part from which an image grows, per pixel, and of growth, per pixel of the rest: the time on a core with AVX2, on which
/// `gradient_tree` takes 0.8 to 1.4 times as long as its work.
pub(super) const FIND_PART: f64 = 50.0;
pub(super) const GROWTH: f64 = 150.0;
/// The work of gradient sums on a mosaic, per pixel, and of the second tree by three colours.
pub(super) const SUMS: f64 = 15.0;
pub(super) const SUMS_BY_COLOURS: f64 = 15.0;
/// The work of the lattice of a mosaic before its trees, per pixel of the lattice.
pub(super) const LATTICE: f64 = 120.0;

/// The work of `gradient_tree` on an image of noise, in ns per pixel: the most that it does.
pub const WORK_OF_NOISE: f64 = 500.0;
/// The work of `gradient_tree`, per pixel, without steep differences, and what one that has them adds.
const TREE: [f64; 2] = [70.0, 900.0];
/// Second differences above this share of the peak, 80 of 256 codes, are steep for `gradient_tree`.
const STEEP: i16 = 80 << 8;
/// One row of so many is read.
const ROWS_PER_SAMPLE: usize = 16;

/// The work that is left for a frame, in ns.
#[derive(Clone, Copy, Debug)]
pub(super) struct Budget {
    left: f64,
    is_exceeded: bool,
}

impl Default for Budget {
    /// Returns one without a limit.
    fn default() -> Self {
        Self::of_ms(f64::INFINITY)
    }
}

impl Budget {
    /// Returns a budget of so many ms, which may be infinite.
    pub fn of_ms(ms: f64) -> Self {
        Self { left: 1e6 * ms, is_exceeded: false }
    }

    /// Returns the work that is left, in ms.
    pub fn left_ms(&self) -> f64 {
        1e-6 * self.left
    }

    /// Takes the work of something that is done anyway.
    pub fn spend(&mut self, work: f64) {
        self.left = (self.left - work).max(0.0);
    }

    /// Takes the work, and returns whether it was left.
    pub fn take(&mut self, work: f64) -> bool {
        let is_left = work <= self.left;
        self.is_exceeded |= !is_left;
        self.spend(if is_left { work } else { 0.0 });
        is_left
    }

    /// Returns whether something was left out.
    pub fn is_exceeded(&self) -> bool {
        self.is_exceeded
    }
}

/// Returns the work of `gradient_tree` on codes with a peak of 2^16 (H x W x C, interleaved), by the share of the pixels with a steep second
/// difference along their row.
pub(super) fn of_tree(codes: &[u16], (height, width, channels): (usize, usize, usize)) -> f64 {
    let stride = width * channels;
    let (mut steep, mut all) = (0, 0);
    for row in codes.chunks_exact(stride).step_by(ROWS_PER_SAMPLE).filter(|_| width > 2) {
        steep += match channels {
            1 => widest!(steep_pixels::<1>(row)),
            _ => widest!(steep_pixels::<3>(row)),
        };
        all += width - 2;
    }
    let [flat, of_steep] = TREE;
    (height * width) as f64 * (flat + of_steep * f64::from(steep) / all.max(1) as f64).min(WORK_OF_NOISE)
}

/// Returns the number of the pixels of a row with a second difference that is steep in a channel.
#[inline(always)]
fn steep_pixels<const C: usize>(row: &[u16]) -> u32 {
    let row = row.as_chunks::<C>().0;
    let triples = row.iter().zip(&row[1..]).zip(&row[2..]);
    let is_steep = |((before, here), after): ((&[u16; C], &[u16; C]), &[u16; C])| {
        (0..C).fold(false, |steep, c| {
            let bend = before[c].wrapping_add(after[c]).wrapping_sub(here[c].wrapping_mul(2)).cast_signed();
            steep | (bend.unsigned_abs() > STEEP.unsigned_abs())
        })
    };
    triples.map(|triple| u32::from(is_steep(triple))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_that_is_not_left_is_not_taken() {
        let mut budget = Budget::of_ms(1.0);
        assert!(budget.take(0.6e6) && !budget.is_exceeded());
        assert!(!budget.take(0.5e6) && budget.is_exceeded());
        assert!(budget.take(0.4e6), "the rest is still there");
        budget.spend(1.0);
        assert_eq!(budget.left_ms(), 0.0);
        assert!((0..9).all(|_| Budget::default().take(1e18)));
    }

    /// A ramp has no steep second differences, and each pixel of a chessboard of a quarter of the peak has one.
    #[test]
    fn the_work_of_a_tree_follows_the_steep_pixels() {
        for channels in [1, 3] {
            let work = |code: fn(usize, usize) -> usize| {
                let codes =
                    (0..40 * 50 * channels).map(|at| code(at / channels / 50, at / channels % 50) as u16);
                of_tree(&codes.collect::<Vec<_>>(), (40, 50, channels)) / 2000.0
            };
            assert_eq!(work(|i, j| 20_000 * (i + j)), TREE[0]);
            assert_eq!(work(|i, j| 16_384 * ((i + j) % 2)), WORK_OF_NOISE);
            assert_eq!(
                work(|_, j| if j == 20 { 16_000 } else { 0 }),
                TREE[0] + TREE[1] / 48.0,
                "one pixel of 48, twice as steep as beside it"
            );
        }
        assert_eq!(of_tree(&[1, 2], (1, 2, 1)), 2.0 * TREE[0]);
    }
}
