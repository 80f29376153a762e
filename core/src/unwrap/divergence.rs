//! Computes the divergence of the wrapped gradients of an image, `D^T M_b(D y)`, directly from its codes.
//!
//! A code of b bits occupies the upper b of 16 bits, so that M_b is the wrapping arithmetic of the machine.

use super::{Integers, Range, UnwrapError};
use crate::dct::{LANES, SampleRun};
use crate::frame::Frame;
use crate::simd::widest;

/// An interleaved image, scaled so that its peak is 2^16.
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
        let seen = match Integers::of(y)? {
            Integers::U8(samples) => fill(&mut self.samples, samples, range),
            Integers::U16(samples) => fill(&mut self.samples, samples, range),
        };
        // Bits that no code has come from a sample that has them.
        if u32::from(seen) >> range.bits() == 0 { Ok(()) } else { Integers::checked(y, range).map(|_| ()) }
    }

    /// Returns a run of sixteen codes, with 0 beyond the end of the row.
    #[inline(always)]
    pub fn at(&self, SampleRun { row, sample }: SampleRun) -> [u16; LANES] {
        let rest = &self.samples[row * self.stride..][..self.stride][sample..];
        match rest.first_chunk() {
            Some(codes) => *codes,
            None => tail(rest),
        }
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

    #[inline(never)]
    fn divergence_at_border(&self, SampleRun { row, sample }: SampleRun) -> [f32; LANES] {
        let start = row * self.stride;
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

#[cold]
#[inline(never)]
fn tail(rest: &[u16]) -> [u16; LANES] {
    std::array::from_fn(|lane| rest.get(lane).copied().unwrap_or(0))
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
