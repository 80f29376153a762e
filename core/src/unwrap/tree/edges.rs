//! Edges between neighbours, and their order: what changes least is trusted first.

use super::regions::Triple;
use crate::unwrap::wrapped::{difference, turns};

/// Keys count 1/512 of a peak, summed over three channels, up to four peaks.
const KEY_SHIFT: u32 = 7;
const MOST: u32 = 2047;

/// "`to` is `step` wraps above `from`."
#[derive(Clone, Copy)]
pub(in crate::unwrap) struct Edge {
    /// How much changes along it.
    pub key: u16,
    pub from: u32,
    pub to: u32,
    pub step: Triple,
}

/// The way from a pixel to its neighbour.
#[derive(Clone, Copy)]
pub(in crate::unwrap) enum Direction {
    Right,
    Down,
}

impl Direction {
    /// The neighbour's index minus the pixel's, in an image of `width`.
    pub fn stride(self, width: usize) -> usize {
        match self {
            Self::Right => 1,
            Self::Down => width,
        }
    }

    /// Whether `pixel` has that neighbour, in an image of `width` and `count` pixels.
    pub fn reaches(self, pixel: usize, width: usize, count: usize) -> bool {
        match self {
            Self::Right => !(pixel + 1).is_multiple_of(width),
            Self::Down => pixel + width < count,
        }
    }
}

/// Key of a change of `sum`, absolute values summed over three channels, 2^16 a peak.
pub(in crate::unwrap) fn key(sum: u32) -> u16 {
    (sum >> KEY_SHIFT).min(MOST) as u16
}

impl Edge {
    /// Between two nodes with codes `a` and `b`, if the true difference is M_b(b - a) + n * 2^b.
    pub fn between((from, a): (u32, [u16; 3]), (to, b): (u32, [u16; 3]), n: Triple) -> Self {
        let (mut sum, mut step) = (0, n);
        for lane in 0..3 {
            let change = i32::from(difference(a[lane], b[lane])) + (i32::from(n[lane]) << 16);
            sum += change.unsigned_abs().min(1 << 18);
            step[lane] = n[lane].wrapping_add(turns(a[lane], b[lane]));
        }
        Self { key: key(sum), from, to, step }
    }
}

/// Sorts by key, edges of one key in the order in which they are; keys up to `flat` count as one.
pub(in crate::unwrap) fn sort(edges: &[Edge], flat: u16, sorted: &mut Vec<Edge>) {
    let bucket = |edge: &Edge| usize::from(edge.key.max(flat));
    let mut next = vec![0usize; MOST as usize + 2];
    edges.iter().for_each(|edge| next[bucket(edge) + 1] += 1);
    for i in 1..next.len() {
        next[i] += next[i - 1];
    }
    sorted.clear();
    sorted.resize(edges.len(), Edge { key: 0, from: 0, to: 0, step: [0; 3] });
    for edge in edges {
        let place = &mut next[bucket(edge)];
        sorted[*place] = *edge;
        *place += 1;
    }
}
