//! Arithmetic modulo 2^b by the machine's own wrapping: a code of b bits occupies the upper b bits of a word, so
//! that the peak is the modulus of the word.

/// A signed machine word; one peak is its modulus. A code less half a peak is a word, so that codes have the order of words, as their differences
/// have: only signed words are compared in one step on all machines.
pub(super) trait Word: Copy + Default + Ord + Send + Sync {
    /// The number of bits.
    const BITS: u8;
    /// Half a peak, which counts as negative.
    const HALF: Self;

    /// A signed number that holds the second differences of radiance, up to the largest count for which words of this width are used.
    type Radiance: Copy + Default + Ord + Into<i32>;

    /// Returns the radiance `y + k * 2^bits`.
    fn radiance(y: u16, k: u8, bits: u8) -> Self::Radiance;
    /// Returns so many eighths of the peak `2^bits`, rounded down.
    fn eighths(eighths: u16, bits: u8) -> Self::Radiance;
    /// Returns the radiance behind `to` that has no second difference from `from` over `to`.
    fn straight_on(from: Self::Radiance, to: Self::Radiance) -> Self::Radiance;
    /// Returns the number of second differences at samples `here`, at most 2^14, between two pairs of others whose magnitude is above `limit`,
    /// and the greatest magnitude. All lines have one length.
    fn bends(
        here: &[Self::Radiance],
        pairs: [[&[Self::Radiance]; 2]; 2],
        limit: Self::Radiance,
    ) -> (u64, Self::Radiance);

    /// Returns the lower bits of `value`.
    fn low(value: u16) -> Self;
    /// Returns the number from 0 on that has the bits of the word.
    fn unsigned(self) -> u16;
    /// Returns the sum modulo one peak.
    fn plus(self, other: Self) -> Self;
    /// Returns the difference modulo one peak.
    fn minus(self, other: Self) -> Self;
    /// Returns the difference, and the end of the range of words where it lies beyond.
    fn minus_within(self, other: Self) -> Self;

    /// Returns the word of a code of so many bits.
    #[inline(always)]
    fn of_code(code: u16, bits: u8) -> Self {
        Self::low(code << (Self::BITS - bits)).plus(Self::HALF)
    }

    /// Returns so many sixteenths of the peak.
    #[inline(always)]
    fn sixteenths(sixteenths: u16) -> Self {
        Self::low(sixteenths << (Self::BITS - 4))
    }

    /// Returns 1 if `condition` holds, else 0.
    #[inline(always)]
    fn one_if(condition: bool) -> Self {
        Self::low(u16::from(condition))
    }
}

macro_rules! word {
    ($type:ty, $radiance:ty) => {
        impl Word for $type {
            type Radiance = $radiance;

            const BITS: u8 = <$type>::BITS as u8;
            const HALF: Self = <$type>::MIN;

            #[inline(always)]
            fn radiance(y: u16, k: u8, bits: u8) -> $radiance {
                (y as $radiance) + (<$radiance>::from(k) << bits)
            }
            #[inline(always)]
            fn eighths(eighths: u16, bits: u8) -> $radiance {
                ((eighths as $radiance) << bits) / 8
            }
            #[inline(always)]
            fn straight_on(from: $radiance, to: $radiance) -> $radiance {
                to.wrapping_add(to).wrapping_sub(from)
            }
            #[inline(always)]
            fn bends(
                here: &[$radiance],
                [first, second]: [[&[$radiance]; 2]; 2],
                limit: $radiance,
            ) -> (u64, $radiance) {
                let (mut above, mut greatest): ($radiance, $radiance) = (0, 0);
                let [first, second] = [first, second].map(|[before, after]| before.iter().zip(after));
                for ((&here, first), second) in here.iter().zip(first).zip(second) {
                    let twice = here.wrapping_add(here);
                    let [first, second] = [first, second].map(|(&before, after)| {
                        before.wrapping_add(*after).wrapping_sub(twice).wrapping_abs()
                    });
                    above += <$radiance>::from(first > limit) + <$radiance>::from(second > limit);
                    greatest = greatest.max(first).max(second);
                }
                (above as u64, greatest)
            }
            #[inline(always)]
            fn low(value: u16) -> Self {
                value as $type
            }
            #[inline(always)]
            fn unsigned(self) -> u16 {
                self.cast_unsigned().into()
            }
            #[inline(always)]
            fn plus(self, other: Self) -> Self {
                self.wrapping_add(other)
            }
            #[inline(always)]
            fn minus(self, other: Self) -> Self {
                self.wrapping_sub(other)
            }
            #[inline(always)]
            fn minus_within(self, other: Self) -> Self {
                self.saturating_sub(other)
            }
        }
    };
}
word!(i8, i16);
word!(i16, i32);

/// Returns M_b(to - from).
pub(super) fn difference(from: u16, to: u16) -> i16 {
    to.wrapping_sub(from) as i16
}

/// Returns M_b(to - from) plus half a peak, which is a code itself.
#[inline(always)]
pub(super) fn biased(from: u16, to: u16) -> u16 {
    to.wrapping_sub(from).wrapping_sub(1 << 15)
}

/// Returns the n in {-1, 0, 1} with `M_b(to - from) = to - from + n * 2^b` of two codes or of two wrapped differences.
#[inline(always)]
pub(super) fn wrap_step<W: Word>(from: W, to: W) -> W {
    // The difference without wrapping is out of range in exactly one direction.
    W::one_if(to < from).minus(W::one_if(to.minus(from) < W::default()))
}

/// Returns whether the magnitude of a wrapped difference is above so many sixteenths of the peak, less than half of it.
#[inline(always)]
pub(super) fn exceeds<W: Word>(difference: W, sixteenths: u16) -> bool {
    let limit = W::sixteenths(sixteenths);
    // One comparison after a shift of the origin replaces two at both ends.
    difference.plus(limit).plus(W::HALF) > limit.plus(limit).plus(W::HALF)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::gradient::{self, wrap_centered};

    /// Compares all functions with their definitions, for codes `a` and `b` of `bits` bits.
    fn check<W: Word + Into<i32>>(a: u16, b: u16, bits: u8) {
        let mask = ((1u32 << bits) - 1) as u16;
        let y = [a & mask, b & mask];
        let [from, to] = y.map(|y| W::of_code(y, bits));
        let scale = f32::from(1u16 << (W::BITS - bits));
        let change = f32::from(y[1]) - f32::from(y[0]);
        let want = wrap_centered(change, bits) * scale;
        let difference = to.minus(from);
        assert_eq!(difference.into() as f32, want);
        assert_eq!(wrap_step(from, to).into(), gradient::wrap_step(change, bits));
        for sixteenths in 1..8 {
            let limit = i32::from(sixteenths << (W::BITS - 4));
            assert_eq!(exceeds(difference, sixteenths), difference.into().abs() > limit);
        }
    }

    proptest! {
        #[test]
        fn is_the_arithmetic_of_the_definition(a: u16, b: u16, bits in 1u8..=16) {
            check::<i16>(a, b, bits);
            check::<i8>(a, b, 1 + (bits - 1) % 8);
        }

        #[test]
        fn raised_differences_wrap_as_differences_do(a: u16, b: u16, c: u16) {
            let (left, right) = (i32::from(difference(a, b)), i32::from(difference(b, c)));
            let wrapped = (right - left + (1 << 15)).rem_euclid(1 << 16) - (1 << 15);
            prop_assert_eq!(i32::from(difference(biased(a, b), biased(b, c))), wrapped);
            let step = wrap_step(difference(a, b), difference(b, c));
            prop_assert_eq!(i32::from(step), (wrapped - (right - left)) >> 16);
        }
    }
}
