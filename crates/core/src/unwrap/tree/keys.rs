//! The keys of edges: the change along an edge in one number; the smallest is taken first.
//!
//! `key = sum_c |d_c| + 2 (max_c d_c - min_c d_c)`, where d is the wrapped difference. Light and shade change all
//! channels alike, so the second term is small for them, while a difference that is wrapped in one channel stands out.

use super::pixels::Quad;
use crate::simd::widest;
use crate::unwrap::wrapped::{biased, difference};

/// Returns the key of the change `M_b(to - from) + n * 2^b`; a peak is 2^14.
pub(in crate::unwrap) fn key_of_change(from: [u16; 4], to: [u16; 4], n: Quad) -> u16 {
    let change = |lane: usize| i32::from(difference(from[lane], to[lane])) + (i32::from(n[lane]) << 16);
    // The same scale as for a wrapped difference, since both kinds of keys are compared.
    let [r, g, b] = [0, 1, 2].map(|lane| change(lane) >> 2);
    let spread = r.max(g).max(b) - r.min(g).min(b);
    (r.abs() + g.abs() + b.abs() + 2 * spread).min(i32::from(MAX_KEY)) as u16
}

/// The largest key, above that of any difference without a multiple of the peak.
pub(in crate::unwrap) const MAX_KEY: u16 = u16::MAX - 1;

/// Returns the key of a difference without n; the largest is 3/2 + 2 peaks, which 16 bits hold.
#[inline(always)]
fn key_of_wrapped(d: [u16; 3]) -> u16 {
    // Two bits less leave room for the sum of all terms in 16 bits.
    let [r, g, b] = d.map(|d| (d as i16) >> 2);
    let spread = r.max(g).max(b) - r.min(g).min(b);
    r.unsigned_abs() + g.unsigned_abs() + b.unsigned_abs() + 2 * spread as u16
}

/// Returns the key from code to code, and 1 if it is above `flat` or a channel wraps, else 0.
#[inline(always)]
fn edge(from: [u16; 3], to: [u16; 3], flat: u16) -> (u16, u8) {
    let d: [u16; 3] = std::array::from_fn(|c| to[c].wrapping_sub(from[c]));
    // A turn is a borrow without a sign, or a sign without a borrow: both are the uppermost bit.
    let borrow = |c: usize| (!to[c] & from[c]) | (!(to[c] ^ from[c]) & d[c]);
    let flip = |c: usize| borrow(c) ^ d[c];
    let flipped = (flip(0) | flip(1) | flip(2)) >> 15;
    let key = key_of_wrapped(d);
    (key, (flipped | u16::from(key > flat)) as u8)
}

/// Resizes the maps for `count` pixels and writes 0 where no pixel is `stride` ahead. Returns the number of the
/// other pixels and their part of the maps.
fn with_neighbour<'a>(
    count: usize,
    stride: usize,
    keys: &'a mut Vec<u16>,
    breaks: &'a mut Vec<u8>,
) -> (usize, &'a mut [u16], &'a mut [u8]) {
    let reach = count.saturating_sub(stride);
    keys.resize(count, 0);
    breaks.resize(count, 0);
    keys[reach..].fill(0);
    breaks[reach..].fill(0);
    (reach, &mut keys[..reach], &mut breaks[..reach])
}

/// Computes by pixel the key of the difference to the pixel `stride` ahead, and 1 where it is above `flat` or
/// wraps in a channel, else 0; both are 0 where there is no such pixel. The right neighbour of the last column is
/// the first pixel of the next row.
pub(in crate::unwrap) fn first_difference_keys(
    planes: [&[u16]; 3],
    stride: usize,
    flat: u16,
    keys: &mut Vec<u16>,
    breaks: &mut Vec<u8>,
) {
    let (reach, keys, breaks) = with_neighbour(planes[0].len(), stride, keys, breaks);
    let [from, to] = [0, planes[0].len() - reach].map(|at| planes.map(|plane| &plane[at..at + reach]));
    widest!({
        let ([r0, g0, b0], [r1, g1, b1]) = (from, to);
        for i in 0..reach {
            (keys[i], breaks[i]) = edge([r0[i], g0[i], b0[i]], [r1[i], g1[i], b1[i]], flat);
        }
    });
}

/// Computes [`first_difference_keys`] of the differences to the pixel `a` ahead, between a pixel and the one `b` ahead.
pub(in crate::unwrap) fn second_difference_keys(
    planes: [&[u16]; 3],
    (a, b): (usize, usize),
    flat: u16,
    keys: &mut Vec<u16>,
    breaks: &mut Vec<u8>,
) {
    let (reach, keys, breaks) = with_neighbour(planes[0].len(), a + b, keys, breaks);
    // Slices at the corners would start beyond the end.
    if reach == 0 {
        return;
    }
    let corners = [0, a, b, a + b].map(|at| planes.map(|plane| &plane[at..at + reach]));
    widest!({
        let [[r0, g0, b0], [ra, ga, ba], [rb, gb, bb], [rc, gc, bc]] = corners;
        for i in 0..reach {
            let from = [biased(r0[i], ra[i]), biased(g0[i], ga[i]), biased(b0[i], ba[i])];
            let to = [biased(rb[i], rc[i]), biased(gb[i], gc[i]), biased(bb[i], bc[i])];
            (keys[i], breaks[i]) = edge(from, to, flat);
        }
    });
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::unwrap::tree::wrap_steps;

    proptest! {
        #[test]
        fn keys_of_the_image_are_those_of_its_pixels(
            codes in proptest::collection::vec(any::<[u16; 3]>(), 1..40),
            stride in 1usize..12,
            flat: u16,
        ) {
            let planes = [0, 1, 2].map(|lane| codes.iter().map(|code| code[lane]).collect::<Vec<_>>());
            let planes = [&planes[0][..], &planes[1], &planes[2]];
            let quad = |at: usize| [codes[at][0], codes[at][1], codes[at][2], 0];
            let (mut keys, mut breaks) = (Vec::new(), Vec::new());
            let edge = |from, to| {
                let key = key_of_change(from, to, [0; 4]);
                (key, u8::from(key > flat || wrap_steps(from, to) != [0; 4]))
            };
            first_difference_keys(planes, stride, flat, &mut keys, &mut breaks);
            for at in 0..codes.len() {
                let there = at + stride < codes.len();
                let want = if there { edge(quad(at), quad(at + stride)) } else { (0, 0) };
                prop_assert_eq!((keys[at], breaks[at]), want);
            }
            second_difference_keys(planes, (1, stride), flat, &mut keys, &mut breaks);
            let step = |at: usize| std::array::from_fn(|lane| biased(quad(at)[lane], quad(at + 1)[lane]));
            for at in 0..codes.len() {
                let there = at + stride + 1 < codes.len();
                let want = if there { edge(step(at), step(at + stride)) } else { (0, 0) };
                prop_assert_eq!((keys[at], breaks[at]), want);
            }
        }
    }
}
