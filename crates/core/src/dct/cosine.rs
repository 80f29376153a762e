//! Makhoul's cosine transform: a permutation, one Fourier transform of the same length, and a rotation of each
//! pair of coefficients. Two real sequences share a complex one. The twiddle factors contain the scales that make
//! it orthonormal.
//!
//! J. Makhoul, "A fast cosine transform in one and two dimensions", IEEE Trans. ASSP 28(1), 1980.

use std::f64::consts::PI;

use super::fft::Fft;
use super::lanes::{Complex, Twiddle, Unfused};
use super::library::LibraryPlan;

/// A plan of the DCT-II and DCT-III of one length.
pub(super) struct CosinePlan {
    n: usize,
    algorithm: Algorithm,
    /// The scaled twiddle factors for k = 0 to n/2, the same for both directions; none for the library, which does all by itself.
    twiddles: Vec<Twiddle>,
}

/// A Fourier transform by the factors of its length, or a whole cosine transform by the library.
enum Algorithm {
    Factors(Fft),
    Library(LibraryPlan),
}

/// The memory that a transform needs beside its data.
pub(super) struct Scratch {
    numbers: Vec<Complex>,
    lines: Vec<f32>,
}

impl CosinePlan {
    /// Plans transforms of length `n`, at least 1.
    pub fn new(n: usize) -> Self {
        // Pairs come as sums and differences, twice what they should be.
        let scale = |k| (if k == 0 { 1.0 } else { 0.5 } / n as f64).sqrt();
        let twiddle = |k: usize| Twiddle::new(PI * k as f64 / (2 * n) as f64, scale(k));
        match Fft::new(n) {
            Some(fft) => {
                Self { n, algorithm: Algorithm::Factors(fft), twiddles: (0..=n / 2).map(twiddle).collect() }
            }
            None => Self { n, algorithm: Algorithm::Library(LibraryPlan::new(n)), twiddles: Vec::new() },
        }
    }

    /// Returns the scratch of the transforms.
    pub fn scratch(&self) -> Scratch {
        let (numbers, lines) = match &self.algorithm {
            Algorithm::Factors(fft) => (fft.scratch_len(), 0),
            Algorithm::Library(library) => (0, library.scratch_len()),
        };
        Scratch { numbers: vec![Complex::default(); numbers], lines: vec![0.0; lines] }
    }

    /// Returns the position of sample `i` before a forward transform and after an inverse one.
    #[inline(always)]
    pub fn position(&self, i: usize) -> usize {
        match self.algorithm {
            Algorithm::Library(_) => i,
            // Makhoul's order: the even samples ascend from the front, the odd ones descend from the end.
            Algorithm::Factors(_) if i.is_multiple_of(2) => i / 2,
            Algorithm::Factors(_) => self.n - 1 - i / 2,
        }
    }

    /// Transforms the samples at their positions in place, for [`CosinePlan::coefficients`].
    pub fn forward(&self, data: &mut [Complex], scratch: &mut Scratch) {
        match &self.algorithm {
            Algorithm::Factors(fft) => fft.forward(data, &mut scratch.numbers),
            Algorithm::Library(library) => library.forward(data, &mut scratch.lines),
        }
    }

    /// Transforms the result of [`CosinePlan::spectrum`] in place to the samples at their positions, with real and imaginary parts
    /// swapped.
    pub fn inverse(&self, data: &mut [Complex], scratch: &mut Scratch) {
        match &self.algorithm {
            // Swapped parts make the forward transform an inverse one.
            Algorithm::Factors(fft) => fft.forward(data, &mut scratch.numbers),
            Algorithm::Library(library) => library.inverse(data, &mut scratch.lines),
        }
    }

    /// Returns the pairs (k, n - k) that belong together; 0 and a possible n/2 are paired with themselves.
    #[inline(always)]
    pub fn pairs(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let n = self.n;
        (0..=n / 2).map(move |k| (k, (n - k) % n))
    }

    /// Returns the coefficients k and n - k of both sequences from the output of [`CosinePlan::forward`] there.
    #[inline(always)]
    pub fn coefficients(&self, k: usize, [p, q]: [Complex; 2]) -> [Complex; 2] {
        let Some(&Twiddle { cos, sin }) = self.twiddles.get(k) else { return [p, q] };
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

    /// Returns the input of [`CosinePlan::inverse`] at k and n - k from the coefficients there.
    #[inline(always)]
    pub fn spectrum(&self, k: usize, [x, y]: [Complex; 2]) -> [Complex; 2] {
        let Some(&Twiddle { cos, sin }) = self.twiddles.get(k) else { return [x.swapped(), y.swapped()] };
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
