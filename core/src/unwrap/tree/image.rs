//! The image as a ground: its counts are k.

use super::forest::{Forest, Ground};
use super::pixels::{Bounds, Direction, Pixels, Quad, add, turns};
use crate::unwrap::{Range, Recovered, congruence};

/// Keys up to this, 56 of 256 codes, are as good as flat.
const FLAT: u16 = 56 << 6;

/// Differences are `M_b(d y) + n * 2^b`.
pub(in crate::unwrap) struct Image<'a> {
    pub pixels: &'a Pixels,
    pub bounds: Bounds,
    /// By pixel, to the right and down.
    pub keys: [&'a [u16]; 2],
    /// Like `keys`, or empty where all are 0.
    pub n: [&'a [Quad]; 2],
}

impl Ground for Image<'_> {
    #[inline(always)]
    fn width(&self) -> usize {
        self.pixels.width()
    }

    #[inline(always)]
    fn extent(&self) -> (usize, usize) {
        (self.pixels.count() / self.pixels.width(), self.pixels.width())
    }

    #[inline(always)]
    fn flat(&self) -> u16 {
        FLAT
    }

    fn has_sea(&self) -> bool {
        false
    }

    #[inline(always)]
    fn tie(&self, _at: usize) -> Option<u16> {
        None
    }

    #[inline(always)]
    fn interval(&self, at: usize) -> (Quad, Quad) {
        let code = self.pixels.code(at);
        match self.bounds.at_full_scale(code).filter(|_| self.is_plateau(at)) {
            Some(most) => (most, most),
            None => ([0; 4], self.bounds.highest(code)),
        }
    }

    #[inline(always)]
    fn key(&self, to: Direction, at: usize) -> u16 {
        self.keys[to as usize][at]
    }

    #[inline(always)]
    fn step(&self, to: Direction, at: usize) -> Quad {
        let step = turns(self.pixels.code(at), self.pixels.code(at + self.pixels.stride(to)));
        self.n[to as usize].get(at).map_or(step, |&n| add(step, n))
    }
}

impl Image<'_> {
    /// Whether the 3 x 3 pixels around `at` have one code.
    fn is_plateau(&self, at: usize) -> bool {
        let width = self.pixels.width();
        let column = at % width;
        let inside = self.pixels.has_colours()
            && column > 0
            && column + 1 < width
            && at >= width
            && at + width < self.pixels.count();
        let code = self.pixels.code(at);
        inside
            && [at - width, at, at + width]
                .iter()
                .all(|&middle| (middle - 1..=middle + 1).all(|there| self.pixels.code(there) == code))
    }
}

/// Writes `out`: the largest region at the offset that keeps it in range, others at their least.
pub(in crate::unwrap) fn place(forest: &mut Forest, pixels: &Pixels, range: Range, out: &mut Recovered) {
    let base = bases(forest, range, out.k.dim().2);
    let shift = 16 - range.bits();
    let (most, peak) = (i16::from(range.most_wraps()), range.peak());
    let channels = out.k.dim().2;
    let (Some(x), Some(counts)) = (out.x.as_slice_mut(), out.k.as_slice_mut()) else { return };
    let targets = x.chunks_exact_mut(channels).zip(counts.chunks_exact_mut(channels));
    for (at, (x, count)) in targets.enumerate() {
        let k = add(forest.offset[at], base[forest.run_of[at] as usize]);
        let code = pixels.code(at);
        for channel in 0..channels {
            let k = k[channel].clamp(0, most);
            count[channel] = k as u8;
            x[channel] = f32::from(code[channel] >> shift) + f32::from(k) * peak;
        }
    }
}

/// By node, the k of its value 0.
fn bases(forest: &mut Forest, range: Range, channels: usize) -> Vec<Quad> {
    forest.regions.flatten();
    let regions = &forest.regions;
    let main = regions.largest();
    let mut level = [0; 4];
    let mut k = Vec::with_capacity(forest.run_of.len());
    for (channel, level) in level.iter_mut().enumerate().take(channels) {
        let of_main = forest.run_of.iter().zip(&forest.offset).filter(|(run, _)| regions.root(**run) == main);
        k.clear();
        k.extend(
            of_main.map(|(&run, offset)| {
                i32::from(offset[channel].wrapping_add(regions.above_root(run)[channel]))
            }),
        );
        *level = -congruence::zero_level(&k, i32::from(range.most_wraps())) as i16;
    }
    let base = |node| {
        let root = regions.root(node);
        let level = if root == main { level } else { regions.region(root).low };
        add(level, regions.above_root(node))
    };
    (0..regions.count()).map(base).collect()
}
