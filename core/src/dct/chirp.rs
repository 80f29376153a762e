//! Bluestein's Fourier transform of any length: a convolution with a chirp, by
//! two transforms of a longer length that has small factors only.
//!
//! L. Bluestein, "A linear filtering approach to the computation of discrete
//! Fourier transform", IEEE Trans. AU 18(4), 1970.

use std::f64::consts::{PI, TAU};

use super::fft::Fft;
use super::lanes::{Arithmetic, Complex, Fused, Plain, Turn, fuses};
use crate::simd::widest;

/// A forward transform of one length.
pub(super) struct Chirp {
    /// `exp(-i pi k^2 / n)`, k below n.
    chirp: Vec<Turn>,
    /// Spectrum of the opposite chirp, divided by its length.
    response: Vec<Turn>,
    fft: Fft,
}

impl Chirp {
    /// `n` is at least 1.
    pub fn new(n: usize) -> Self {
        let mut room = 2 * n - 1;
        let fft = loop {
            match Fft::short(room) {
                Some(fft) => break fft,
                None => room += 1,
            }
        };
        let angle = |k: usize| PI * ((k * k) % (2 * n)) as f64 / n as f64;
        let chirp = (0..n).map(|k| turn(angle(k), 1.0)).collect();
        Self { chirp, response: response(n, room, angle), fft }
    }

    /// Length of the data.
    pub fn len(&self) -> usize {
        self.response.len()
    }

    /// Length of the scratch.
    pub fn room(&self) -> usize {
        self.fft.room()
    }

    /// As [`Fft::forward`], on data of length [`Chirp::len`] whose rear it overwrites.
    pub fn forward(&self, data: &mut [Complex], scratch: &mut [Complex]) {
        if fuses() {
            widest(
                #[inline(always)]
                || self.enter::<Fused>(data),
            );
        } else {
            self.enter::<Plain>(data);
        }
        self.fft.forward(data, scratch);
        if fuses() {
            widest(
                #[inline(always)]
                || self.convolve::<Fused>(data),
            );
        } else {
            self.convolve::<Plain>(data);
        }
        self.fft.forward(data, scratch);
        if fuses() {
            widest(
                #[inline(always)]
                || self.leave::<Fused>(data),
            );
        } else {
            self.leave::<Plain>(data);
        }
    }

    #[inline(always)]
    fn enter<A: Arithmetic>(&self, samples: &mut [Complex]) {
        let (samples, rear) = samples.split_at_mut(self.chirp.len());
        for (sample, &turn) in samples.iter_mut().zip(&self.chirp) {
            *sample = sample.turned::<A>(turn);
        }
        rear.fill(Complex::default());
    }

    /// Swapped parts make the next forward transform an inverse one.
    #[inline(always)]
    fn convolve<A: Arithmetic>(&self, spectrum: &mut [Complex]) {
        for (value, &turn) in spectrum.iter_mut().zip(&self.response) {
            *value = value.turned::<A>(turn).swapped();
        }
    }

    #[inline(always)]
    fn leave<A: Arithmetic>(&self, result: &mut [Complex]) {
        for (value, &turn) in result.iter_mut().zip(&self.chirp) {
            *value = value.swapped().turned::<A>(turn);
        }
    }
}

fn turn(angle: f64, scale: f64) -> Turn {
    Turn { cos: (scale * angle.cos()) as f32, sin: (scale * angle.sin()) as f32 }
}

/// Spectrum of `exp(i angle(|k|))`, |k| below n, at length `room`: even, so that cosines suffice.
fn response(n: usize, room: usize, angle: impl Fn(usize) -> f64) -> Vec<Turn> {
    let cosines: Vec<f64> = (0..room).map(|k| (TAU * k as f64 / room as f64).cos()).collect();
    let chirp: Vec<(f64, f64)> = (0..n).map(|k| angle(k).sin_cos()).collect();
    let at = |frequency: usize| {
        let (mut re, mut im) = (chirp[0].1, chirp[0].0);
        let mut phase = 0;
        for &(sin, cos) in &chirp[1..] {
            phase += frequency;
            phase -= if phase >= room { room } else { 0 };
            re += 2.0 * cos * cosines[phase];
            im += 2.0 * sin * cosines[phase];
        }
        Turn { cos: (re / room as f64) as f32, sin: (-im / room as f64) as f32 }
    };
    (0..room).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_factors() {
        for n in [1, 2, 3, 23, 60, 365] {
            let samples: Vec<Complex> = (0..n)
                .map(|i| Complex::of(std::array::from_fn(|lane| ((i * 37 + lane * 11) % 19) as f32 - 9.0)))
                .collect();
            let chirp = Chirp::new(n);
            let (mut got, mut want) = (samples.clone(), samples);
            got.resize(chirp.len(), Complex::default());
            chirp.forward(&mut got, &mut vec![Complex::default(); chirp.room()]);
            let fft = Fft::new(n).unwrap();
            fft.forward(&mut want, &mut vec![Complex::default(); fft.room()]);
            for (got, want) in got.iter().zip(&want) {
                let worst =
                    got.reals().iter().zip(want.reals()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(worst < 1e-3, "n {n}: off by {worst}");
            }
        }
    }
}
