//! Transforms of any odd length R by their definition and its symmetry: `X_j` and `X_(R-j)` share `sum_k cos(2 pi
//! j k / R) (x_k + x_(R-k))` and `sum_k sin(2 pi j k / R) (x_k - x_(R-k))`, k = 1 to (R-1)/2.

use std::f64::consts::TAU;

use super::lanes::{Complex, MultiplyAdd, Twiddle};

/// The longest transform.
pub(super) const MAX_RADIX: usize = 73;

/// The number of pairs of outputs that are summed at once, so that their sums stay in registers.
const BLOCK: usize = 3;

/// A plan of one length: cos and sin of all j and k, in the order in which they are read.
pub(super) struct OddRadix {
    pairs: usize,
    /// The factors by block of j, by k, by j in the block; 0 where the last block has no j.
    twiddles: Vec<[Twiddle; BLOCK]>,
}

/// Buffers for the sums and differences of the inputs.
pub(super) struct Folded {
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
                let out = BLOCK * block + j + 1;
                if out <= self.pairs {
                    put(out, cosines[j].minus_i(sines[j]));
                    put(radix - out, cosines[j].plus_i(sines[j]));
                }
            }
        }
    }
}
