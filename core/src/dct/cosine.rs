//! Makhoul's cosine transform: a permutation, one Fourier transform of the same length, and a rotation of each
//! pair of coefficients. Two real sequences share a complex one. The twiddle factors contain the scales that make
//! it orthonormal.
//!
//! J. Makhoul, "A fast cosine transform in one and two dimensions", IEEE Trans. ASSP 28(1), 1980.

use std::f64::consts::PI;

use super::bluestein::Bluestein;
use super::fft::Fft;
use super::lanes::{Complex, Twiddle, Unfused};

/// A plan of the DCT-II and DCT-III of one length.
pub(super) struct CosinePlan {
    n: usize,
    fourier: Fourier,
    /// The scaled twiddle factors for k = 0 to n/2, the same for both directions.
    twiddles: Vec<Twiddle>,
}

/// The algorithm of the Fourier transform: by the factors of its length, or Bluestein's.
enum Fourier {
    Factors(Fft),
    Bluestein(Bluestein),
}

impl CosinePlan {
    /// Plans transforms of length `n`, at least 1.
    pub fn new(n: usize) -> Self {
        // Pairs come as sums and differences, twice what they should be.
        let scale = |k| (if k == 0 { 1.0 } else { 0.5 } / n as f64).sqrt();
        let twiddle = |k: usize| Twiddle::new(PI * k as f64 / (2 * n) as f64, scale(k));
        // Bluestein's transform is more than twice as long, so it serves only lengths with a large prime factor.
        let fourier = match Fft::new(n) {
            Some(fft) => Fourier::Factors(fft),
            None => Fourier::Bluestein(Bluestein::new(n)),
        };
        Self { n, fourier, twiddles: (0..=n / 2).map(twiddle).collect() }
    }

    /// Returns the lengths of the data and of the scratch of [`CosinePlan::fourier`].
    pub fn buffer_lengths(&self) -> [usize; 2] {
        match &self.fourier {
            Fourier::Factors(fft) => [self.n, fft.scratch_len()],
            Fourier::Bluestein(chirp) => [chirp.len(), chirp.scratch_len()],
        }
    }

    /// Returns the position of sample `i` before a forward transform and after an inverse one.
    #[inline(always)]
    pub fn position(&self, i: usize) -> usize {
        // Makhoul's order: the even samples ascend from the front, the odd ones descend from the end.
        if i.is_multiple_of(2) { i / 2 } else { self.n - 1 - i / 2 }
    }

    /// Runs the Fourier transform in the middle of either direction, in place.
    pub fn fourier(&self, data: &mut [Complex], scratch: &mut [Complex]) {
        match &self.fourier {
            Fourier::Factors(fft) => fft.forward(data, scratch),
            Fourier::Bluestein(chirp) => chirp.forward(data, scratch),
        }
    }

    /// Returns the pairs (k, n - k) that belong together; 0 and a possible n/2 are paired with themselves.
    #[inline(always)]
    pub fn pairs(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let n = self.n;
        (0..=n / 2).map(move |k| (k, (n - k) % n))
    }

    /// Returns the coefficients k and n - k of both sequences from the output of [`CosinePlan::fourier`] there.
    #[inline(always)]
    pub fn coefficients(&self, k: usize, [p, q]: [Complex; 2]) -> [Complex; 2] {
        let Twiddle { cos, sin } = self.twiddles[k];
        // Coefficient 0 is paired with itself, and its angle has no sine.
        if k == 0 {
            return [p.scaled(cos); 2];
        }
        // Two real sequences share one complex transform; its even and odd parts separate them again.
        let (re, im) = (
            Complex { re: p.re.plus(q.re), im: p.im.plus(q.im) },
            Complex { re: p.im.minus(q.im), im: q.re.minus(p.re) },
        );
        [im.scaled_plus::<Unfused>(sin, re.scaled(cos)), im.scaled_plus::<Unfused>(-cos, re.scaled(sin))]
    }

    /// Returns the input of [`CosinePlan::fourier`] at k and n - k that gives the samples at their positions,
    /// with real and imaginary parts swapped.
    #[inline(always)]
    pub fn spectrum(&self, k: usize, [x, y]: [Complex; 2]) -> [Complex; 2] {
        let Twiddle { cos, sin } = self.twiddles[k];
        if k == 0 {
            return [x.scaled(cos).swapped(); 2];
        }
        // a and b: the spectra of the two sequences, at k.
        let re = y.scaled_plus::<Unfused>(sin, x.scaled(cos));
        let im = y.scaled_plus::<Unfused>(-cos, x.scaled(sin));
        let (a_re, b_re, a_im, b_im) = (re.re, re.im, im.re, im.im);
        [
            Complex { re: a_im.plus(b_re), im: a_re.minus(b_im) },
            Complex { re: b_re.minus(a_im), im: a_re.plus(b_im) },
        ]
    }
}
