//! Arithmetic modulo 2^b that the machine's own 16-bit wrapping does: a code of
//! b bits stands in the upper b of 16 bits, so that one peak is one full turn.

use super::Range;

/// `y` (integers below 2^b) as codes, replacing what `codes` held.
pub(super) fn codes(y: &[f32], range: Range, codes: &mut Vec<u16>) {
    let shift = 16 - range.bits();
    codes.clear();
    codes.extend(y.iter().map(|&y| (y as i32 as u16) << shift));
}

/// M_b(to - from).
pub(super) fn difference(from: u16, to: u16) -> i16 {
    to.wrapping_sub(from) as i16
}

/// The n in {-1, 0, 1} with `M_b(to - from) = to - from + n * 2^b`.
///
/// For codes (`u16`) and, as the order is the same, for differences shifted up by [`raised`].
pub(super) fn turns(from: u16, to: u16) -> i16 {
    let wrapped = difference(from, to);
    i16::from((to < from) & (wrapped >= 0)) - i16::from((to > from) & (wrapped < 0))
}

/// M_b(to - from) plus half a peak, which makes it a code itself.
pub(super) fn raised(from: u16, to: u16) -> u16 {
    to.wrapping_sub(from) ^ HALF
}

/// The absolute value of a difference that [`raised`] gave.
pub(super) fn size(raised: u16) -> u16 {
    raised.abs_diff(HALF)
}

const HALF: u16 = 1 << 15;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::gradient::{wrap_centered, wraps_across};

    proptest! {
        #[test]
        fn is_the_arithmetic_of_the_definition(a in any::<u16>(), b in any::<u16>(), bits in 1u8..=16) {
            let range = Range::new(bits, 1.0).unwrap();
            let y = [a, b].map(|value| f32::from(value >> (16 - bits)));
            let mut shifted = Vec::new();
            codes(&y, range, &mut shifted);
            let (from, to, scale) = (shifted[0], shifted[1], f32::from(1u16 << (16 - bits)));
            let want = wrap_centered(y[1] - y[0], bits);
            prop_assert_eq!(f32::from(difference(from, to)), want * scale);
            prop_assert_eq!(i32::from(turns(from, to)), wraps_across(y[1] - y[0], bits));
            prop_assert_eq!(f32::from(size(raised(from, to))), want.abs() * scale);
        }

        #[test]
        fn raised_differences_wrap_as_differences_do(a: u16, b: u16, c: u16) {
            let (left, right) = (i32::from(difference(a, b)), i32::from(difference(b, c)));
            let wrapped = (right - left + (1 << 15)).rem_euclid(1 << 16) - (1 << 15);
            let (from, to) = (raised(a, b), raised(b, c));
            prop_assert_eq!(i32::from(difference(from, to)), wrapped);
            prop_assert_eq!(i32::from(turns(from, to)), (wrapped - (right - left)) >> 16);
        }
    }
}
