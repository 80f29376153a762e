//! Arithmetic modulo 2^b by the machine's own wrapping: a code of b bits occupies the upper b bits of a word, so
//! that the peak is the modulus of the word.

/// An unsigned machine word; one peak is its modulus.
pub(super) trait Word: Copy + Default + Ord + Send + Sync + Into<u16> {
    /// The number of bits.
    const BITS: u8;
    /// Half a peak.
    const HALF: Self;

    /// A signed number that holds the second differences of radiance, up to the largest count for which words of this width are used.
    type Radiance: Copy + Default + Ord + Into<i32>;

    /// Returns the radiance `y + k * 2^bits`.
    fn radiance(y: u16, k: u8, bits: u8) -> Self::Radiance;
    /// Returns so many eighths of the peak `2^bits`, rounded down.
    fn eighths(eighths: u16, bits: u8) -> Self::Radiance;
    /// Returns the number of second differences between three lines whose magnitude is above `limit`, and the greatest magnitude.
    fn bends<const N: usize>(
        lines: [&[Self::Radiance; N]; 3],
        limit: Self::Radiance,
    ) -> (u64, Self::Radiance);

    /// Returns the lower bits of `value`.
    fn low(value: u16) -> Self;
    /// Returns the sum modulo one peak.
    fn plus(self, other: Self) -> Self;
    /// Returns the difference modulo one peak.
    fn minus(self, other: Self) -> Self;

    /// Returns 1 if `condition` holds, else 0.
    #[inline(always)]
    fn one_if(condition: bool) -> Self {
        Self::low(u16::from(condition))
    }

    /// Adds half a peak, which gives signed differences the order of codes.
    #[inline(always)]
    fn bias(self) -> Self {
        self.minus(Self::HALF)
    }
}

macro_rules! word {
    ($type:ty, $radiance:ty) => {
        impl Word for $type {
            type Radiance = $radiance;

            const BITS: u8 = <$type>::BITS as u8;
            // The sign bit: as in two's complement, half a peak counts as negative.
            const HALF: Self = 1 << (<$type>::BITS - 1);

            #[inline(always)]
            fn radiance(y: u16, k: u8, bits: u8) -> $radiance {
                (y as $radiance) + (<$radiance>::from(k) << bits)
            }
            #[inline(always)]
            fn eighths(eighths: u16, bits: u8) -> $radiance {
                ((eighths as $radiance) << bits) / 8
            }
            #[inline(always)]
            fn bends<const N: usize>(
                [before, here, after]: [&[$radiance; N]; 3],
                limit: $radiance,
            ) -> (u64, $radiance) {
                let (mut above, mut greatest): ($radiance, $radiance) = (0, 0);
                for l in 0..N {
                    let bend = before[l]
                        .wrapping_add(after[l])
                        .wrapping_sub(here[l])
                        .wrapping_sub(here[l])
                        .wrapping_abs();
                    above += <$radiance>::from(bend > limit);
                    greatest = greatest.max(bend);
                }
                (above as u64, greatest)
            }
            #[inline(always)]
            fn low(value: u16) -> Self {
                value as $type
            }
            #[inline(always)]
            fn plus(self, other: Self) -> Self {
                self.wrapping_add(other)
            }
            #[inline(always)]
            fn minus(self, other: Self) -> Self {
                self.wrapping_sub(other)
            }
        }
    };
}
word!(u8, i16);
word!(u16, i32);

/// Returns M_b(to - from).
pub(super) fn difference(from: u16, to: u16) -> i16 {
    to.wrapping_sub(from) as i16
}

/// Returns the n in {-1, 0, 1} with `M_b(to - from) = to - from + n * 2^b`.
///
/// It holds for codes and for differences that [`biased`] has made, as both have the same order.
#[inline(always)]
pub(super) fn wrap_step<W: Word>(from: W, to: W) -> W {
    // The difference without wrapping is out of range in exactly one direction: a borrow, or half a peak and more.
    W::one_if(to < from).minus(W::one_if(to.minus(from) >= W::HALF))
}

/// Returns M_b(to - from) plus half a peak, which is a code itself.
#[inline(always)]
pub(super) fn biased<W: Word>(from: W, to: W) -> W {
    to.minus(from).bias()
}

/// Returns the absolute value of a difference that [`biased`] has made.
#[cfg(test)]
pub(super) fn magnitude<W: Word>(biased: W) -> W {
    if biased < W::HALF { W::HALF.minus(biased) } else { biased.minus(W::HALF) }
}

/// Returns whether `magnitude(biased)` is above `sixteenths / 16` of the peak, in fewer steps.
#[inline(always)]
pub(super) fn exceeds<W: Word>(biased: W, sixteenths: u16) -> bool {
    let limit = W::low(sixteenths << (W::BITS - 4));
    // One comparison after a shift of the origin replaces two at both ends.
    biased.minus(W::HALF.minus(limit)) > limit.plus(limit)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::gradient::{self, wrap_centered};

    /// Returns a word as a number from minus half a peak on.
    fn signed<W: Word>(word: W) -> i32 {
        i32::from(word.bias().into()) - i32::from(W::HALF.into())
    }

    /// Compares all functions with their definitions, for codes `a` and `b` of `bits` bits.
    fn check<W: Word + std::fmt::Debug>(a: u16, b: u16, bits: u8) {
        let mask = ((1u32 << bits) - 1) as u16;
        let y = [a & mask, b & mask];
        let [from, to] = y.map(|y| W::low(y << (W::BITS - bits)));
        let scale = f32::from(1u16 << (W::BITS - bits));
        let change = f32::from(y[1]) - f32::from(y[0]);
        let want = wrap_centered(change, bits) * scale;
        assert_eq!(signed(to.minus(from)) as f32, want);
        assert_eq!(signed(wrap_step(from, to)), gradient::wrap_step(change, bits));
        let biased = biased(from, to);
        assert_eq!(f32::from(magnitude(biased).into()), want.abs());
        for sixteenths in 1..8 {
            let limit = sixteenths << (W::BITS - 4);
            assert_eq!(exceeds(biased, sixteenths), magnitude(biased).into() > limit);
        }
    }

    proptest! {
        #[test]
        fn is_the_arithmetic_of_the_definition(a: u16, b: u16, bits in 1u8..=16) {
            check::<u16>(a, b, bits);
            check::<u8>(a, b, 1 + (bits - 1) % 8);
        }

        #[test]
        fn raised_differences_wrap_as_differences_do(a: u16, b: u16, c: u16) {
            let (left, right) = (i32::from(difference(a, b)), i32::from(difference(b, c)));
            let wrapped = (right - left + (1 << 15)).rem_euclid(1 << 16) - (1 << 15);
            let (from, to) = (biased(a, b), biased(b, c));
            prop_assert_eq!(i32::from(difference(from, to)), wrapped);
            prop_assert_eq!(i32::from(wrap_step(from, to).cast_signed()), (wrapped - (right - left)) >> 16);
        }
    }
}
