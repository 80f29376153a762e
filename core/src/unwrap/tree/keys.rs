//! How much changes from here to there, in one number: what changes least is trusted first.
//!
//! `key = sum_c |d_c| + 2 (max_c d_c - min_c d_c)`, d the wrapped difference. The second term
//! is what light and shade do not do: they change all channels alike, while
//! a difference that is wrapped in one channel stands out.

use super::pixels::Quad;
use crate::simd::widest;
use crate::unwrap::wrapped::difference;

/// Of the change `M_b(to - from) + n * 2^b`, 2^14 a peak.
pub(in crate::unwrap) fn of_difference(from: [u16; 4], to: [u16; 4], n: Quad) -> u16 {
    let change = |lane: usize| i32::from(difference(from[lane], to[lane])) + (i32::from(n[lane]) << 16);
    let [r, g, b] = [0, 1, 2].map(|lane| change(lane) >> 2);
    let spread = r.max(g).max(b) - r.min(g).min(b);
    (r.abs() + g.abs() + b.abs() + 2 * spread).min(i32::from(MOST)) as u16
}

/// No key is larger: more than any difference without a whole peak has.
pub(in crate::unwrap) const MOST: u16 = u16::MAX - 1;

/// The same of differences without n: the largest is 3/2 + 2 peaks, which 16 bits hold.
#[inline(always)]
fn of_wrapped(r: u16, g: u16, b: u16) -> u16 {
    let [r, g, b] = [r, g, b].map(|d| (d as i16) >> 2);
    let spread = r.max(g).max(b) - r.min(g).min(b);
    r.unsigned_abs() + g.unsigned_abs() + b.unsigned_abs() + 2 * spread as u16
}

/// By pixel, the key of the difference to the pixel `stride` ahead; 0 where there is none.
/// Of the last column the right neighbour is the next row's first; nobody asks.
pub(in crate::unwrap) fn first(planes: [&[u16]; 3], stride: usize, keys: &mut Vec<u16>) {
    let count = planes[0].len();
    keys.clear();
    keys.resize(count, 0);
    let reach = count.saturating_sub(stride);
    let from = planes.map(|plane| &plane[..reach]);
    let to = planes.map(|plane| &plane[count - reach..]);
    widest(|| {
        for (i, key) in keys[..reach].iter_mut().enumerate() {
            let d = |c: usize| to[c][i].wrapping_sub(from[c][i]);
            *key = of_wrapped(d(0), d(1), d(2));
        }
    });
}

/// [`first`] of the difference's difference: `y` at 0, minus at `a`, minus at `b`, plus at `a + b`.
pub(in crate::unwrap) fn second(planes: [&[u16]; 3], (a, b): (usize, usize), keys: &mut Vec<u16>) {
    let count = planes[0].len();
    keys.clear();
    keys.resize(count, 0);
    let reach = count.saturating_sub(a + b);
    if reach == 0 {
        return;
    }
    let corner = |at: usize| planes.map(|plane| &plane[at..at + reach]);
    let (y0, ya, yb, yab) = (corner(0), corner(a), corner(b), corner(a + b));
    widest(|| {
        for (i, key) in keys[..reach].iter_mut().enumerate() {
            let d = |c: usize| y0[c][i].wrapping_sub(ya[c][i]).wrapping_sub(yb[c][i]).wrapping_add(yab[c][i]);
            *key = of_wrapped(d(0), d(1), d(2));
        }
    });
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn keys_of_the_image_are_those_of_its_pixels(
            codes in proptest::collection::vec(any::<[u16; 3]>(), 1..40),
            stride in 1usize..12,
        ) {
            let planes = [0, 1, 2].map(|lane| codes.iter().map(|code| code[lane]).collect::<Vec<_>>());
            let planes = [&planes[0][..], &planes[1], &planes[2]];
            let quad = |at: usize| [codes[at][0], codes[at][1], codes[at][2], 0];
            let (mut once, mut twice) = (Vec::new(), Vec::new());
            first(planes, stride, &mut once);
            second(planes, (1, stride), &mut twice);
            for at in 0..codes.len() {
                let want = |reach: usize, key: &dyn Fn() -> u16| if at + reach < codes.len() { key() } else { 0 };
                prop_assert_eq!(once[at], want(stride, &|| of_difference(quad(at), quad(at + stride), [0; 4])));
                let step = |at: usize| std::array::from_fn(|lane| quad(at + 1)[lane].wrapping_sub(quad(at)[lane]));
                prop_assert_eq!(twice[at], want(stride + 1, &|| of_difference(step(at), step(at + stride), [0; 4])));
            }
        }
    }
}
