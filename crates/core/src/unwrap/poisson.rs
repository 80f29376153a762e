//! Solves the least-squares problem of the wrapped gradients of an image by cosine transforms (eq. 3), with the hard
//! threshold of SPUD. [`Codes`] computes the right-hand side of its equation.

use std::f64::consts::PI;

use super::{Integers, Range, UnwrapError, of_width};
use crate::dct::{ImageDct, LANES, SampleRun, SpectralFilter, load_run};
use crate::frame::Frame;
use crate::simd::widest;
use crate::workers::Workers;

/// The coefficients that SPUD's threshold applies to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum ThresholdOn {
    /// Those after the division, as in the paper's scripts.
    #[default]
    Phi,
    /// Those before the division, as in eq. 3.
    Rho,
}

/// A solver for images of one size; `Out` is the output for a run of sixteen samples of phi.
pub(super) struct Poisson<Out> {
    pub grid: ImageDct<Out>,
    by_row: Vec<[f32; LANES]>,
    by_column: Vec<f32>,
}

impl<Out: Copy + Default + Send + Sync> Poisson<Out> {
    /// Plans for images of `dim`, (height, width, channels), all at least 1; each channel is solved separately.
    pub fn new(dim: (usize, usize, usize), workers: usize) -> Self {
        let mut by_row = vec![[0.0; LANES]; dim.0.div_ceil(LANES)];
        by_row.as_flattened_mut().iter_mut().zip(eigenvalues(dim.0)).for_each(|(to, value)| *to = value);
        Self { grid: ImageDct::new(dim, workers), by_row, by_column: eigenvalues(dim.1).collect() }
    }

    /// Solves `D^T D phi = rho` for the phi of mean 0, where `rho` is a divergence `D^T g`, and stores the output
    /// of `keep`.
    ///
    /// Coefficients of magnitude `tau` (in the unit of rho) or less are set to 0, before or after the division.
    pub fn solve(
        &mut self,
        workers: &Workers,
        rho: impl Fn(SampleRun) -> [f32; LANES] + Sync,
        (tau, on): (f32, ThresholdOn),
        keep: impl Fn(SampleRun, [f32; LANES]) -> Out + Sync,
    ) {
        let Self { grid, by_row, by_column } = self;
        let (by_row, by_column) = (&by_row[..], &by_column[..]);
        match on {
            // One closure for each order, so that no branch remains in the loop over coefficients.
            ThresholdOn::Phi => {
                let rule = move |v: f32, h: f32, c: f32| threshold(divide_or_zero(c, v + h), tau);
                grid.filter(workers, rho, &SpectralFilter { by_row, by_column, rule }, keep);
            }
            ThresholdOn::Rho => {
                let rule = move |v: f32, h: f32, c: f32| divide_or_zero(threshold(c, tau), v + h);
                grid.filter(workers, rho, &SpectralFilter { by_row, by_column, rule }, keep);
            }
        }
    }
}

/// Returns `2 - 2 cos(pi i / n)` as `4 sin^2(pi i / 2n)`, which is accurate at small i.
fn eigenvalues(n: usize) -> impl Iterator<Item = f32> {
    (0..n).map(move |i| (4.0 * (PI * i as f64 / (2 * n) as f64).sin().powi(2)) as f32)
}

/// Returns the quotient, or 0 for an eigenvalue of 0: a gradient does not contain the mean.
#[inline(always)]
fn divide_or_zero(coefficient: f32, eigenvalue: f32) -> f32 {
    // The quotient comes first: a selection afterwards needs no branch, and infinity is dropped.
    let quotient = coefficient / eigenvalue;
    if eigenvalue > 0.0 { quotient } else { 0.0 }
}

#[inline(always)]
fn threshold(coefficient: f32, tau: f32) -> f32 {
    // With tau = 0 only coefficients fail that are 0 already, so the threshold is off.
    if coefficient.abs() > tau { coefficient } else { 0.0 }
}

/// An interleaved image and the divergence of its wrapped gradients, `D^T M_b(D y)`. A code of b bits occupies the
/// upper b of 16 bits, so that the peak is 2^16 and M_b is the wrapping arithmetic of the machine.
#[derive(Default)]
pub(super) struct Codes {
    samples: Vec<u16>,
    stride: usize,
    channels: usize,
}

impl Codes {
    /// Reads the codes of `y`.
    ///
    /// # Errors
    /// [`UnwrapError`] when `y` has float samples, or a code that is out of `range`.
    pub fn read(&mut self, y: &Frame, range: Range) -> Result<(), UnwrapError> {
        (self.stride, self.channels) = (y.width() * y.channels(), y.channels());
        let seen = of_width!(Integers::of(y, range)?, samples => fill(&mut self.samples, samples, range));
        // Bits that no code has come from a sample that has them.
        if u32::from(seen) >> range.bits() == 0 { Ok(()) } else { Integers::checked(y, range).map(|_| ()) }
    }

    /// Returns a run of sixteen codes, with 0 beyond the end of the row.
    #[inline(always)]
    pub fn at(&self, run: SampleRun) -> [u16; LANES] {
        load_run(&self.samples, self.stride, run)
    }

    /// Returns a run of sixteen samples of the divergence, with 0 beyond the end of the row; half a peak is 2^15.
    #[inline(always)]
    pub fn divergence(&self, run @ SampleRun { row, sample }: SampleRun) -> [f32; LANES] {
        let here = row * self.stride + sample;
        let last = sample + LANES + self.channels > self.stride;
        // Inside the image all five runs can be loaded without a check for each lane.
        let top = row == 0 || here + self.stride + LANES > self.samples.len();
        if top || last || sample < self.channels {
            return self.divergence_at_border(run);
        }
        let chunk =
            |at: usize| -> [u16; LANES] { *self.samples[at..].first_chunk().expect("this is no border") };
        let middle = chunk(here);
        let [left, right] = [chunk(here - self.channels), chunk(here + self.channels)];
        let [above, below] = [chunk(here - self.stride), chunk(here + self.stride)];
        let mut out = [0.0; LANES];
        for lane in 0..LANES {
            // D^T D with wrapped differences: what flows in from the left and from above minus what flows out.
            let horizontal = difference(left[lane], middle[lane]) - difference(middle[lane], right[lane]);
            let vertical = difference(above[lane], middle[lane]) - difference(middle[lane], below[lane]);
            out[lane] = (horizontal + vertical) as f32;
        }
        out
    }

    // Out of line: borders are few, and the loop over the inside stays small without them.
    #[inline(never)]
    fn divergence_at_border(&self, SampleRun { row, sample }: SampleRun) -> [f32; LANES] {
        let start = row * self.stride;
        // Lanes beyond the end of the row stay 0 and add nothing to the transform.
        let inside = self.stride.saturating_sub(sample).min(LANES);
        let mut out = [0.0; LANES];
        for (lane, out) in out.iter_mut().enumerate().take(inside) {
            let (at, here) = (sample + lane, start + sample + lane);
            let toward = |there: usize| difference(self.samples[there], self.samples[here]);
            let mut sum = 0;
            sum += if at >= self.channels { toward(here - self.channels) } else { 0 };
            sum -= if at + self.channels < self.stride {
                difference(self.samples[here], self.samples[here + self.channels])
            } else {
                0
            };
            sum += if row > 0 { toward(here - self.stride) } else { 0 };
            sum -= self
                .samples
                .get(here + self.stride)
                .map_or(0, |&below| difference(self.samples[here], below));
            *out = sum as f32;
        }
        out
    }
}

/// Shifts all samples up, and returns the bits that occur in them.
fn fill<T: Copy + Into<u16>>(codes: &mut Vec<u16>, samples: &[T], range: Range) -> u16 {
    codes.resize(samples.len(), 0);
    widest!({
        let mut seen = 0;
        for (code, &sample) in codes.iter_mut().zip(samples) {
            let sample = sample.into();
            seen |= sample;
            *code = sample << (16 - range.bits());
        }
        seen
    })
}

#[inline(always)]
fn difference(from: u16, to: u16) -> i32 {
    i32::from(to.wrapping_sub(from).cast_signed())
}
