//! Stockham's Fourier transform of many sequences at once, one pass for each factor of the length; input and
//! output are in natural order. The first pass goes through all memory. It leaves short transforms, which the
//! other passes finish one after the other in the nearest cache.

use std::f64::consts::TAU;

use super::lanes::{Complex, Fused, MultiplyAdd, Twiddle, Unfused, has_fma};
use crate::simd::widest;

/// A plan of forward transforms of one length without a prime factor above [`MAX_RADIX`].
pub(super) struct Fft {
    /// The first pass over the whole; `None` at length 1.
    first: Option<Pass>,
    /// The passes over each of the transforms that the first pass leaves.
    others: Vec<Pass>,
}

/// A pass of `count` transforms of length `radix`, each on `stride` neighbours.
struct Pass {
    butterfly: Butterfly,
    radix: usize,
    count: usize,
    stride: usize,
    /// The twiddle factors of outputs 1 to radix - 1, by transform.
    twiddles: Vec<Twiddle>,
}

enum Butterfly {
    Two,
    Three,
    Four,
    Five,
    Odd(OddRadix),
}

impl Fft {
    /// Plans transforms of length `n`; `None` when it has a prime factor above [`MAX_RADIX`].
    pub fn new(n: usize) -> Option<Self> {
        let radices = radices(n)?;
        let [radix, others @ ..] = &radices[..] else {
            return Some(Self { first: None, others: Vec::new() });
        };
        let mut rest: usize = others.iter().product();
        let first = Some(Pass::new(*radix, rest, 1));
        // The stride grows by each radix: Stockham's passes sort while they compute, so no bit reversal is needed.
        let mut stride = 1;
        let pass = |&radix: &usize| {
            rest /= radix;
            stride *= radix;
            Pass::new(radix, rest, stride / radix)
        };
        Some(Self { first, others: others.iter().map(pass).collect() })
    }

    /// Returns the length of the scratch that [`Fft::forward`] needs.
    pub fn scratch_len(&self) -> usize {
        self.first.as_ref().map_or(0, |pass| (pass.radix + 2) * pass.count)
    }

    /// Transforms `data`, of the planned length, in place.
    pub fn forward(&self, data: &mut [Complex], scratch: &mut [Complex]) {
        // Without fused multiply-add there are no wider vectors either, see `widest`.
        if has_fma() { widest!(self.run::<Fused>(data, scratch)) } else { self.run::<Unfused>(data, scratch) }
    }

    #[inline(always)]
    fn run<A: MultiplyAdd>(&self, data: &mut [Complex], scratch: &mut [Complex]) {
        let Some(first) = &self.first else { return };
        // Stockham's passes need two buffers. `data` is the source of the first pass and the target of the last one.
        let (apart, near) = scratch.split_at_mut(data.len());
        first.run::<A>((data, 1), (apart, 1));
        let Some((last, middle)) = self.others.split_last() else { return data.copy_from_slice(apart) };
        // What is left are transforms that are short enough to stay near, one after the other.
        let (mut near, mut other) = near.split_at_mut(first.count);
        for q in 0..first.radix {
            let mut from = (&apart[q..], first.radix);
            for pass in middle {
                pass.run::<A>(from, (near, 1));
                (near, other) = (other, near);
                from = (other, 1);
            }
            last.run::<A>(from, (&mut data[q..], first.radix));
        }
    }
}

/// Returns the factors of `n` with odd primes first: their passes load the most and rotate the least.
fn radices(n: usize) -> Option<Vec<usize>> {
    // A composite odd number is left to its prime factors, which cost less.
    let (mut rest, mut radices) = (n, Vec::new());
    for radix in (7..=MAX_RADIX).rev().step_by(2).chain([5, 4, 3, 2]) {
        while rest.is_multiple_of(radix) && (radix < 9 || (3..radix).step_by(2).all(|d| radix % d != 0)) {
            radices.push(radix);
            rest /= radix;
        }
    }
    (rest == 1).then_some(radices)
}

impl Pass {
    fn new(radix: usize, count: usize, stride: usize) -> Self {
        let twiddle = |p: usize, j: usize| Twiddle::new(TAU * (p * j) as f64 / (radix * count) as f64, 1.0);
        let twiddles = (0..count).flat_map(|p| (1..radix).map(move |j| twiddle(p, j))).collect();
        let butterfly = match radix {
            2 => Butterfly::Two,
            3 => Butterfly::Three,
            4 => Butterfly::Four,
            5 => Butterfly::Five,
            _ => Butterfly::Odd(OddRadix::new(radix)),
        };
        Self { butterfly, radix, count, stride, twiddles }
    }

    /// Runs the pass; both slices come with the distance of successive numbers. Radices are closures, because a
    /// function would be called by its shim, which is not inlined.
    #[inline(always)]
    fn run<A: MultiplyAdd>(&self, from: (&[Complex], usize), to: (&mut [Complex], usize)) {
        match &self.butterfly {
            Butterfly::Two => self.short::<A, 2>(
                from,
                to,
                #[inline(always)]
                |[a, b]| two([a, b]),
            ),
            Butterfly::Three => self.short::<A, 3>(
                from,
                to,
                #[inline(always)]
                |inputs| three::<A>(inputs),
            ),
            Butterfly::Four => self.short::<A, 4>(
                from,
                to,
                #[inline(always)]
                |[a, b, c, d]| four([a, b, c, d]),
            ),
            Butterfly::Five => self.short::<A, 5>(
                from,
                to,
                #[inline(always)]
                |inputs| five::<A>(inputs),
            ),
            Butterfly::Odd(odd) => self.long::<A>(odd, from, to),
        }
    }

    #[inline(always)]
    fn short<A: MultiplyAdd, const R: usize>(
        &self,
        (from, step): (&[Complex], usize),
        (to, out_step): (&mut [Complex], usize),
        transform: impl Fn([Complex; R]) -> [Complex; R],
    ) {
        let apart = self.count * self.stride;
        for (p, twiddles) in self.twiddles.chunks_exact(R - 1).enumerate() {
            let first = p * self.stride;
            // One slice for each input, so that its bounds are checked here and not in the inner loop.
            let mut inputs = [from; R];
            for (i, input) in inputs.iter_mut().enumerate() {
                *input = &from[(i * apart + first) * step..];
            }
            let out = &mut to[R * first * out_step..];
            for q in 0..self.stride {
                let mut values = [Complex::default(); R];
                for (value, input) in values.iter_mut().zip(&inputs) {
                    *value = input[q * step];
                }
                let result = transform(values);
                out[q * out_step] = result[0];
                for j in 1..R {
                    // The first transform of a pass, and so all of the last pass, twiddles by nothing.
                    out[(j * self.stride + q) * out_step] =
                        if p == 0 { result[j] } else { result[j].rotated::<A>(twiddles[j - 1]) };
                }
            }
        }
    }

    #[inline(always)]
    fn long<A: MultiplyAdd>(
        &self,
        odd: &OddRadix,
        (from, step): (&[Complex], usize),
        (to, out_step): (&mut [Complex], usize),
    ) {
        let apart = self.count * self.stride;
        // The buffers are cleared once, not for each transform.
        let mut folded = Folded::new();
        for (p, twiddles) in self.twiddles.chunks_exact(self.radix - 1).enumerate() {
            let first = p * self.stride;
            let out = &mut to[self.radix * first * out_step..];
            for q in 0..self.stride {
                odd.transform::<A>(
                    &mut folded,
                    #[inline(always)]
                    |i| from[(i * apart + first + q) * step],
                    #[inline(always)]
                    |j, value| {
                        out[(j * self.stride + q) * out_step] =
                            if j == 0 { value } else { value.rotated::<A>(twiddles[j - 1]) };
                    },
                );
            }
        }
    }
}

/// cos and sin of pi/3 and of multiples of 2 pi/5.
const SIN_3: f32 = 0.866_025_4;
const COS_5: [f32; 2] = [0.309_017, -0.809_017];
const SIN_5: [f32; 2] = [0.951_056_5, 0.587_785_25];

#[inline(always)]
fn two([a, b]: [Complex; 2]) -> [Complex; 2] {
    [a.plus(b), a.minus(b)]
}

#[inline(always)]
fn three<A: MultiplyAdd>([a, b, c]: [Complex; 3]) -> [Complex; 3] {
    let (sum, difference) = (b.plus(c), b.minus(c).scaled(SIN_3));
    let middle = sum.scaled_plus::<A>(-0.5, a);
    [a.plus(sum), middle.minus_i(difference), middle.plus_i(difference)]
}

#[inline(always)]
fn four([a, b, c, d]: [Complex; 4]) -> [Complex; 4] {
    let [even, odd] = two([a, c]);
    let [sum, difference] = two([b, d]);
    [even.plus(sum), odd.minus_i(difference), even.minus(sum), odd.plus_i(difference)]
}

#[inline(always)]
fn five<A: MultiplyAdd>([a, b, c, d, e]: [Complex; 5]) -> [Complex; 5] {
    let ([u, v], [t, w]) = (two([b, e]), two([c, d]));
    let near = t.scaled_plus::<A>(COS_5[1], u.scaled_plus::<A>(COS_5[0], a));
    let far = t.scaled_plus::<A>(COS_5[0], u.scaled_plus::<A>(COS_5[1], a));
    let near_odd = w.scaled_plus::<A>(SIN_5[1], v.scaled(SIN_5[0]));
    let far_odd = w.scaled_plus::<A>(-SIN_5[0], v.scaled(SIN_5[1]));
    [
        a.plus(u).plus(t),
        near.minus_i(near_odd),
        far.minus_i(far_odd),
        far.plus_i(far_odd),
        near.plus_i(near_odd),
    ]
}

/// The longest transform of a single pass.
const MAX_RADIX: usize = 73;

/// The number of pairs of outputs that are summed at once, so that their sums stay in registers.
const BLOCK: usize = 3;

/// A transform of any odd length R by its definition and its symmetry: `X_j` and `X_(R-j)` share `sum_k cos(2 pi j k /
/// R) (x_k + x_(R-k))` and `sum_k sin(2 pi j k / R) (x_k - x_(R-k))`, k = 1 to (R-1)/2.
struct OddRadix {
    pairs: usize,
    /// The factors by block of j, by k, by j in the block; those beyond the last j are not used.
    twiddles: Vec<[Twiddle; BLOCK]>,
}

/// Buffers for the sums and differences of the inputs.
struct Folded {
    even: [Complex; MAX_RADIX / 2],
    odd: [Complex; MAX_RADIX / 2],
}

impl Folded {
    #[inline(always)]
    pub fn new() -> Self {
        Self { even: [Complex::default(); MAX_RADIX / 2], odd: [Complex::default(); MAX_RADIX / 2] }
    }
}

impl OddRadix {
    /// Plans transforms of length `radix`, odd, 3 to [`MAX_RADIX`].
    pub fn new(radix: usize) -> Self {
        let pairs = radix / 2;
        // The product is reduced before it becomes an angle: large angles would lose their digits.
        let twiddle = |j: usize, k: usize| Twiddle::new(TAU * ((j * k) % radix) as f64 / radix as f64, 1.0);
        let block = |first: usize, k| std::array::from_fn(|j| twiddle(first + j, k));
        let firsts = (1..=pairs).step_by(BLOCK);
        Self { pairs, twiddles: firsts.flat_map(|first| (1..=pairs).map(move |k| block(first, k))).collect() }
    }

    /// Transforms the inputs `take(i)`; `put(j, X_j)` receives each output once.
    #[inline(always)]
    pub fn transform<A: MultiplyAdd>(
        &self,
        Folded { even, odd }: &mut Folded,
        take: impl Fn(usize) -> Complex,
        mut put: impl FnMut(usize, Complex),
    ) {
        let radix = 2 * self.pairs + 1;
        let first = take(0);
        let (even, odd) = (&mut even[..self.pairs], &mut odd[..self.pairs]);
        // x_k and x_(R-k) always meet as a sum or a difference, which halves the multiplications.
        let mut sum = first;
        for (k, (even, odd)) in even.iter_mut().zip(odd.iter_mut()).enumerate() {
            let (a, b) = (take(k + 1), take(radix - 1 - k));
            (*even, *odd) = (a.plus(b), a.minus(b));
            sum = sum.plus(*even);
        }
        put(0, sum);
        for (block, twiddles) in self.twiddles.chunks_exact(self.pairs).enumerate() {
            // Several outputs at once, so that each load of an input feeds more than one sum.
            let (mut cosines, mut sines) = ([first; BLOCK], [Complex::default(); BLOCK]);
            for ((even, odd), twiddles) in even.iter().zip(odd.iter()).zip(twiddles) {
                for j in 0..BLOCK {
                    cosines[j] = even.scaled_plus::<A>(twiddles[j].cos, cosines[j]);
                    sines[j] = odd.scaled_plus::<A>(twiddles[j].sin, sines[j]);
                }
            }
            for j in 0..BLOCK {
                // The last block may have more sums than there are pairs left.
                let out = BLOCK * block + j + 1;
                if out <= self.pairs {
                    put(out, cosines[j].minus_i(sines[j]));
                    put(radix - out, cosines[j].plus_i(sines[j]));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_primes_are_left_to_others() {
        assert!(Fft::new(2 * 619).is_none() && Fft::new(79).is_none());
        assert_eq!(radices(1242), Some(vec![23, 3, 3, 3, 2]));
    }
}
