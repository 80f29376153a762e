//! Bluestein's Fourier transform of any length: a convolution with a chirp, by two transforms of a greater length
//! that has only small factors.
//!
//! L. Bluestein, "A linear filtering approach to the computation of discrete Fourier transform", IEEE Trans. AU
//! 18(4), 1970.

use std::f64::consts::{PI, TAU};

use super::fft::Fft;
use super::lanes::{Complex, Fused, MultiplyAdd, Twiddle, Unfused, has_fma};
use crate::simd::widest;

/// A plan of forward transforms of one length.
pub(super) struct Bluestein {
    /// The chirp `exp(-i pi k^2 / n)`, k below n.
    chirp: Vec<Twiddle>,
    /// The spectrum of the conjugate chirp, divided by its length.
    response: Vec<Twiddle>,
    fft: Fft,
}

impl Bluestein {
    /// Plans transforms of length `n`, at least 1.
    pub fn new(n: usize) -> Self {
        // A linear convolution of n samples with a chirp of 2 n - 1 must not wrap around.
        let mut padded = 2 * n - 1;
        let fft = loop {
            match Fft::short(padded) {
                Some(fft) => break fft,
                None => padded += 1,
            }
        };
        // k^2 is reduced modulo the period of the chirp first: a large angle would lose its digits.
        let angle = |k: usize| PI * ((k * k) % (2 * n)) as f64 / n as f64;
        let chirp = (0..n).map(|k| Twiddle::new(angle(k), 1.0)).collect();
        Self { chirp, response: response(n, padded, angle), fft }
    }

    /// Returns the length of the data.
    pub fn len(&self) -> usize {
        self.response.len()
    }

    /// Returns the length of the scratch.
    pub fn scratch_len(&self) -> usize {
        self.fft.scratch_len()
    }

    /// Transforms as [`Fft::forward`] does. The data has the length [`Bluestein::len`]; the part after the
    /// samples is overwritten.
    pub fn forward(&self, data: &mut [Complex], scratch: &mut [Complex]) {
        // The choice is made once for a transform, outside of all loops.
        if has_fma() { self.run::<Fused>(data, scratch) } else { self.run::<Unfused>(data, scratch) }
    }

    fn run<A: MultiplyAdd>(&self, data: &mut [Complex], scratch: &mut [Complex]) {
        widest!(self.multiply_samples::<A>(data));
        self.fft.forward(data, scratch);
        widest!(self.convolve::<A>(data));
        self.fft.forward(data, scratch);
        widest!(self.multiply_result::<A>(data));
    }

    #[inline(always)]
    fn multiply_samples<A: MultiplyAdd>(&self, samples: &mut [Complex]) {
        let (samples, rear) = samples.split_at_mut(self.chirp.len());
        for (sample, &twiddle) in samples.iter_mut().zip(&self.chirp) {
            *sample = sample.rotated::<A>(twiddle);
        }
        rear.fill(Complex::default());
    }

    /// Multiplies the spectra. It swaps real and imaginary parts, so that the next forward transform acts as an
    /// inverse one.
    #[inline(always)]
    fn convolve<A: MultiplyAdd>(&self, spectrum: &mut [Complex]) {
        for (value, &twiddle) in spectrum.iter_mut().zip(&self.response) {
            *value = value.rotated::<A>(twiddle).swapped();
        }
    }

    #[inline(always)]
    fn multiply_result<A: MultiplyAdd>(&self, result: &mut [Complex]) {
        for (value, &twiddle) in result.iter_mut().zip(&self.chirp) {
            *value = value.swapped().rotated::<A>(twiddle);
        }
    }
}

/// Returns the spectrum of `exp(i angle(|k|))`, |k| below n, at length `padded`. The sequence is even, so cosines
/// suffice.
fn response(n: usize, padded: usize, angle: impl Fn(usize) -> f64) -> Vec<Twiddle> {
    let cosines: Vec<f64> = (0..padded).map(|k| (TAU * k as f64 / padded as f64).cos()).collect();
    let chirp: Vec<(f64, f64)> = (0..n).map(|k| angle(k).sin_cos()).collect();
    let at = |frequency: usize| {
        let (mut re, mut im) = (chirp[0].1, chirp[0].0);
        // Multiples of the frequency are counted modulo the length: exact angles, and one table of cosines.
        let mut phase = 0;
        for &(sin, cos) in &chirp[1..] {
            phase += frequency;
            phase -= if phase >= padded { padded } else { 0 };
            re += 2.0 * cos * cosines[phase];
            im += 2.0 * sin * cosines[phase];
        }
        // Two forward transforms multiply by their length, which is divided out here. A twiddle factor stands
        // for exp(-i angle), hence the sign.
        Twiddle { cos: (re / padded as f64) as f32, sin: (-im / padded as f64) as f32 }
    };
    (0..padded).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_factors() {
        for n in [1, 2, 3, 23, 60, 365] {
            let samples: Vec<Complex> = (0..n)
                .map(|i| {
                    Complex::from_lanes(std::array::from_fn(|lane| ((i * 37 + lane * 11) % 19) as f32 - 9.0))
                })
                .collect();
            let chirp = Bluestein::new(n);
            let (mut got, mut want) = (samples.clone(), samples);
            got.resize(chirp.len(), Complex::default());
            chirp.forward(&mut got, &mut vec![Complex::default(); chirp.scratch_len()]);
            // These lengths have small factors only, so both algorithms can compute them.
            let fft = Fft::new(n).unwrap();
            fft.forward(&mut want, &mut vec![Complex::default(); fft.scratch_len()]);
            for (got, want) in got.iter().zip(&want) {
                let worst = got
                    .to_lanes()
                    .iter()
                    .zip(want.to_lanes())
                    .map(|(a, b)| (a - b).abs())
                    .fold(0.0, f32::max);
                assert!(worst < 1e-3, "n {n}: off by {worst}");
            }
        }
    }
}
