//! Stockham's Fourier transform of lanes: natural order in and out, between two
//! buffers, one pass a factor of the length.

use std::f64::consts::TAU;

use super::lanes::{Arithmetic, Complex, Fused, Plain, Turn, fuses};
use super::odd::{self, Folded, Odd};
use super::radix;
use crate::simd::widest;

/// A forward transform of one length, which has no prime factor above [`odd::MOST`].
pub(super) struct Fft {
    passes: Vec<Pass>,
}

/// `count` transforms of length `radix`, each on `stride` neighbours.
struct Pass {
    kind: Kind,
    radix: usize,
    count: usize,
    stride: usize,
    /// For output 1 to radix - 1, by transform.
    turns: Vec<Turn>,
}

enum Kind {
    Two,
    Three,
    Four,
    Five,
    Odd(Odd),
}

/// Which of the two buffers a transform has left its result in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    First,
    Second,
}

impl Fft {
    /// `None` when `n` has a prime factor above [`odd::MOST`].
    pub fn new(n: usize) -> Option<Self> {
        Some(Self::by(&radices(n)?))
    }

    /// `None` when `n` has a prime factor above 5.
    pub fn short(n: usize) -> Option<Self> {
        radices(n).filter(|radices| radices.iter().all(|&radix| radix <= 5)).map(|radices| Self::by(&radices))
    }

    fn by(radices: &[usize]) -> Self {
        let mut rest: usize = radices.iter().product();
        let mut stride = 1;
        let pass = |&radix: &usize| {
            rest /= radix;
            stride *= radix;
            Pass::new(radix, rest, stride / radix)
        };
        Self { passes: radices.iter().map(pass).collect() }
    }

    /// Where [`Fft::forward`] leaves its result.
    pub fn side(&self) -> Side {
        if self.passes.len().is_multiple_of(2) { Side::First } else { Side::Second }
    }

    /// Transforms what `first` holds; both are of the planned length.
    pub fn forward(&self, first: &mut [Complex], second: &mut [Complex]) -> Side {
        // Without fused multiply-add there are no wider vectors either, see `widest`.
        if fuses() {
            widest(
                #[inline(always)]
                || self.run::<Fused>(first, second),
            )
        } else {
            self.run::<Plain>(first, second)
        }
        self.side()
    }

    #[inline(always)]
    fn run<A: Arithmetic>(&self, first: &mut [Complex], second: &mut [Complex]) {
        let (mut from, mut to) = (first, second);
        for pass in &self.passes {
            pass.run::<A>(from, to);
            (from, to) = (to, from);
        }
    }
}

/// The factors of `n`, odd primes first: their passes have the most to load and the least to turn.
fn radices(n: usize) -> Option<Vec<usize>> {
    let (mut rest, mut radices) = (n, Vec::new());
    for radix in (7..=odd::MOST).rev().step_by(2).chain([5, 4, 3, 2]) {
        while rest.is_multiple_of(radix) && (radix < 9 || (3..radix).step_by(2).all(|d| radix % d != 0)) {
            radices.push(radix);
            rest /= radix;
        }
    }
    (rest == 1).then_some(radices)
}

impl Pass {
    fn new(radix: usize, count: usize, stride: usize) -> Self {
        let turn = |p: usize, j: usize| {
            let (sin, cos) = (TAU * (p * j) as f64 / (radix * count) as f64).sin_cos();
            Turn { cos: cos as f32, sin: sin as f32 }
        };
        let turns = (0..count).flat_map(|p| (1..radix).map(move |j| turn(p, j))).collect();
        let kind = match radix {
            2 => Kind::Two,
            3 => Kind::Three,
            4 => Kind::Four,
            5 => Kind::Five,
            _ => Kind::Odd(Odd::new(radix)),
        };
        Self { kind, radix, count, stride, turns }
    }

    #[inline(always)]
    fn run<A: Arithmetic>(&self, from: &[Complex], to: &mut [Complex]) {
        match &self.kind {
            Kind::Two => self.short::<A, 2>(from, to, radix::two),
            Kind::Three => self.short::<A, 3>(from, to, radix::three::<A>),
            Kind::Four => self.short::<A, 4>(from, to, radix::four),
            Kind::Five => self.short::<A, 5>(from, to, radix::five::<A>),
            Kind::Odd(odd) => self.long::<A>(odd, from, to),
        }
    }

    #[inline(always)]
    fn short<A: Arithmetic, const R: usize>(
        &self,
        from: &[Complex],
        to: &mut [Complex],
        transform: impl Fn([Complex; R]) -> [Complex; R],
    ) {
        let apart = self.count * self.stride;
        for (p, out) in to.chunks_exact_mut(R * self.stride).enumerate() {
            let inputs: [&[Complex]; R] =
                std::array::from_fn(|i| &from[i * apart + p * self.stride..][..self.stride]);
            let turns = &self.turns[p * (R - 1)..][..R - 1];
            for q in 0..self.stride {
                let result = transform(std::array::from_fn(|i| inputs[i][q]));
                out[q] = result[0];
                for j in 1..R {
                    // The first transform of a pass, and so all of the last pass, turns by nothing.
                    out[j * self.stride + q] =
                        if p == 0 { result[j] } else { result[j].turned::<A>(turns[j - 1]) };
                }
            }
        }
    }

    #[inline(always)]
    fn long<A: Arithmetic>(&self, odd: &Odd, from: &[Complex], to: &mut [Complex]) {
        let apart = self.count * self.stride;
        let mut room = Folded::new();
        for (p, out) in to.chunks_exact_mut(self.radix * self.stride).enumerate() {
            let turns = &self.turns[p * (self.radix - 1)..][..self.radix - 1];
            for q in 0..self.stride {
                odd.transform::<A>(
                    &mut room,
                    |i| from[i * apart + p * self.stride + q],
                    |j, value| {
                        out[j * self.stride + q] =
                            if j == 0 { value } else { value.turned::<A>(turns[j - 1]) };
                    },
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::lanes::LANES;
    use super::*;

    #[test]
    fn is_the_definition_in_every_lane() {
        for n in [1, 2, 3, 4, 5, 7, 8, 9, 12, 23, 46, 73, 75, 121] {
            let value = |i: usize, lane: usize| ((i * 37 + lane * 11) % 19) as f32 - 9.0;
            let mut first = vec![Complex::default(); n];
            for (i, sample) in first.iter_mut().enumerate() {
                sample.re.0 = std::array::from_fn(|lane| value(i, lane));
                sample.im.0 = std::array::from_fn(|lane| value(i + 5, lane));
            }
            let mut second = first.clone();
            let fft = Fft::new(n).unwrap();
            let got = match fft.forward(&mut first, &mut second) {
                Side::First => first,
                Side::Second => second,
            };
            for (k, lane) in (0..n).flat_map(|k| (0..LANES).map(move |lane| (k, lane))) {
                let (mut re, mut im) = (0.0, 0.0);
                for i in 0..n {
                    let (sin, cos) = (TAU * ((i * k) % n) as f64 / n as f64).sin_cos();
                    let (a, b) = (f64::from(value(i, lane)), f64::from(value(i + 5, lane)));
                    (re, im) = (re + a * cos + b * sin, im + b * cos - a * sin);
                }
                let got = (f64::from(got[k].re.0[lane]), f64::from(got[k].im.0[lane]));
                assert!((got.0 - re).abs() + (got.1 - im).abs() < 1e-3, "n {n}, k {k}: {got:?}, {re} {im}");
            }
        }
    }

    #[test]
    fn long_primes_are_left_to_others() {
        assert!(Fft::new(2 * 619).is_none() && Fft::new(79).is_none());
        assert_eq!(radices(1242), Some(vec![23, 3, 3, 3, 2]));
    }
}
