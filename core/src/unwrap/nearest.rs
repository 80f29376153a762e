//! Congruence for estimates that are real numbers: the wrap counts next to phi,
//! and the absolute offset that phi lacks.
//!
//! Everything after phi is an integer: residuals `(phi - y) / 2^b` are kept in
//! [`FINE`]ths of a turn, so that one histogram tells both the fractional offset
//! and how many pixels each wrap count has, and sums do not depend on their order.

use std::f64::consts::TAU;

use super::congruence;
use crate::dct::REALS;

/// Steps of one turn; with 16 bits, residuals of up to 256 turns have room.
const FINE: i32 = 128;

/// Codes whose peak is 2^16 to one step.
const CODES_A_STEP: f32 = 65536.0 / FINE as f32;

/// Residuals that are too large or too small.
const LIMIT: f32 = 32767.0;

/// What a number from 0 to this loses when it is added is its fraction; its integer is left in the lowest bits.
const WHOLE: f32 = 8_388_608.0;

/// `(phi - code)` in steps, rounded down (within 1/256 of a step); both in units whose peak is 2^16.
#[inline(always)]
pub(super) fn residuals(phi: [f32; REALS], codes: [u16; REALS]) -> [i16; REALS] {
    let mut steps = [0; REALS];
    for ((step, phi), code) in steps.iter_mut().zip(phi).zip(codes) {
        let value = ((phi - f32::from(code)) * (1.0 / CODES_A_STEP)).clamp(-LIMIT, LIMIT) + (LIMIT + 1.0);
        // `floor` would be a call into the maths library on plain x86-64, and `as` one number at a time.
        let nearest = (value + WHOLE) - WHOLE;
        let whole = if nearest > value { nearest - 1.0 } else { nearest };
        *step = ((whole + WHOLE).to_bits() as u16 ^ (1 << 15)).cast_signed();
    }
    steps
}

/// How many residuals of one channel there are of each size.
#[derive(Clone)]
pub(super) struct Histogram {
    counts: Vec<u32>,
}

/// From a residual to a wrap count.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Counting {
    offset: i32,
    zero: i32,
    most: i32,
}

/// As many [`Counting`]s side by side, by lane.
#[derive(Clone, Copy)]
pub(super) struct Countings {
    offset: [i32; REALS],
    zero: [i32; REALS],
    most: [i32; REALS],
}

impl Histogram {
    pub fn new() -> Self {
        Self { counts: vec![0; 1 << 16] }
    }

    pub fn clear(&mut self) {
        self.counts.fill(0);
    }

    #[inline(always)]
    pub fn count(&mut self, residual: i16) {
        // The index always fits; the mask says so.
        self.counts[usize::from(residual.cast_unsigned() ^ (1 << 15))] += 1;
    }

    pub fn add(&mut self, other: &Self) {
        self.counts.iter_mut().zip(&other.counts).for_each(|(count, other)| *count += other);
    }

    /// `k = round((phi + s - y) / 2^b) - zero` in `0..=most`: s is the circular mean of the
    /// residuals, zero the level that [`congruence::zero_of`] finds.
    pub fn counting(&self, most: u8) -> Counting {
        let shift = self.mean_phase();
        let offset = ((0.5 + shift) * f64::from(FINE) + 0.5).floor() as i32;
        let mut levels = [0; (1 << 16) / FINE as usize + 2];
        let low = wraps(i32::from(i16::MIN), offset);
        for (residual, &count) in (i32::from(i16::MIN)..).zip(&self.counts) {
            levels[(wraps(residual, offset) - low) as usize] += count as usize;
        }
        let most = i32::from(most);
        Counting { offset, zero: low + congruence::zero_of(&levels, most) as i32, most }
    }

    /// Circular mean of `(y - phi) / 2^b`, in turns, -0.5 to 0.5.
    fn mean_phase(&self) -> f64 {
        let (mut sine, mut cosine) = (0.0, 0.0);
        for step in 0..FINE as usize {
            let count: u64 =
                self.counts.iter().skip(step).step_by(FINE as usize).map(|&c| u64::from(c)).sum();
            let angle = TAU * (step as f64 + 0.5) / f64::from(FINE);
            sine -= count as f64 * angle.sin();
            cosine += count as f64 * angle.cos();
        }
        sine.atan2(cosine) / TAU
    }
}

impl Countings {
    /// `of` each lane.
    pub fn new(of: impl Fn(usize) -> Counting) -> Self {
        let each = |part: fn(Counting) -> i32| std::array::from_fn(|lane| part(of(lane)));
        Self { offset: each(|of| of.offset), zero: each(|of| of.zero), most: each(|of| of.most) }
    }

    /// Wrap counts of residuals.
    #[inline(always)]
    pub fn wraps(&self, residuals: &[i16; REALS]) -> [u8; REALS] {
        let mut counts = [0; REALS];
        for lane in 0..REALS {
            let count = wraps(i32::from(residuals[lane]), self.offset[lane]) - self.zero[lane];
            counts[lane] = count.max(0).min(self.most[lane]) as u8;
        }
        counts
    }
}

#[inline(always)]
fn wraps(residual: i32, offset: i32) -> i32 {
    (residual + offset) >> FINE.ilog2()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_shift_between_estimate_and_image() {
        let x: Vec<f32> = (0..400).map(|i| (i * 5 / 2) as f32 * 256.0).collect();
        for shift in [0.0, 9472.0, -32768.0, -127_872.0] {
            let mut histogram = Histogram::new();
            let residuals: Vec<i16> =
                x.iter().map(|&x| residuals([x + shift; REALS], [(x % 65536.0) as u16; REALS])[0]).collect();
            residuals.iter().for_each(|&residual| histogram.count(residual));
            let counting = histogram.counting(3);
            let counting = Countings::new(|_| counting);
            for (x, residual) in x.iter().zip(residuals) {
                let want = [(x / 65536.0) as u8; REALS];
                assert_eq!(counting.wraps(&[residual; REALS]), want, "shift {shift}, x {x}");
            }
        }
    }

    #[test]
    fn residuals_round_down_and_stay_in_range() {
        let of = |phi| residuals([phi; REALS], [0; REALS])[0];
        assert_eq!([of(0.0), of(510.0), of(512.0), of(-1.0), of(-512.0), of(-513.0)], [0, 0, 1, -1, -1, -2]);
        assert_eq!([of(1e9), of(-1e9), of(f32::MAX)], [32767, -32767, 32767]);
    }
}
