//! Finds hot, dead and stuck samples in y, which contradict all their neighbours, and leaves them out of the unwrapping.
//!
//! Behind a lens, the mixed differences of y change little from one 2 x 2 loop to the next, even at a steep edge. A sample that is off by
//! d adds d to two of its four loops and takes d from the other two. So it is a defect if another value of it makes these loops agree
//! with each other and with the eight loops beside them: if the sum of `|M_b(m - m')|` over all pairs of neighbours falls to less than
//! half. Only the corners of steep loops are looked at, since no other sample can do harm.
//!
//! A defect is replaced by that value, y is unwrapped, and then the defect gets the count that brings it nearest to the value that was
//! found in its place. So it takes part in no vote, tree or quality metric.

use std::ops::Range as Indices;

use super::wrapped::{Word, biased, exceeds};
use super::{Integers, Range, Recovered};
use crate::frame::{Frame, Samples};
use crate::simd::widest;

/// The largest share of the samples that are taken for defects. The count of every second defect differs from that of its neighbours,
/// so that with this share 0.015 % of the counts are wrong. An image with more is sharp, or noisy.
const MOST: f64 = 3e-4;

/// The least deviation of a defect, in eighths of the peak.
const LEAST_DEVIATION: i32 = 1;

/// A defect gets the code of a neighbour from which its sound value differs by at most this part of the peak.
const NEIGHBOUR: i32 = 32;

/// The limit of a steep mixed difference in eighths of the peak, as in the quality metrics.
const STEEP: u16 = 3;

/// Samples that are looked at for each one that may be a defect: a defect in a flat part of the image is a corner of four steep loops,
/// which have nine corners.
const CANDIDATES: usize = 10;

/// The number of neighbouring loops that are looked at together.
const PART: usize = 192;

/// The defects of an image, with buffers.
#[derive(Default)]
pub(super) struct Defects {
    /// The indices of the corners of steep loops in the interleaved samples.
    candidates: Vec<usize>,
    /// The indices of the defects with the codes in their place, in ascending order.
    found: Vec<(usize, u16)>,
    /// The image without them.
    sound: Option<Frame>,
    bytes: [Vec<u8>; 2],
    words: [Vec<u16>; 2],
}

/// The layout of the samples of an image.
#[derive(Clone, Copy)]
struct Grid {
    height: usize,
    width: usize,
    channels: usize,
    range: Range,
}

impl Defects {
    /// Returns `y` without its defects, and their share of the samples; `None` if it has none, or too many to be defects.
    pub fn remove(&mut self, y: &Frame, codes: Integers<'_>, range: Range) -> Option<(&Frame, f32)> {
        let (height, width, channels) = y.dim();
        let grid = Grid { height, width, channels, range };
        let samples = height * width * channels;
        let most = (MOST * samples as f64) as usize;
        self.found.clear();
        self.candidates.clear();
        // Reserved at once, so that no later frame of this size allocates.
        self.found.reserve(most + 1);
        self.candidates.reserve(CANDIDATES * most + 4 * width * channels);
        let few = match codes {
            Integers::U8(codes) => {
                grid.find_steep(codes, &mut self.bytes, CANDIDATES * most, &mut self.candidates)
            }
            Integers::U16(codes) => {
                grid.find_steep(codes, &mut self.words, CANDIDATES * most, &mut self.candidates)
            }
        };
        if few {
            self.candidates.sort_unstable();
            self.candidates.dedup();
            let candidates = self.candidates.iter();
            let found = candidates.filter_map(|&at| Some((at, grid.sound_code(codes, at)?)));
            self.found.extend(found.take(most + 1));
        }
        if self.found.is_empty() || self.found.len() > most {
            self.found.clear();
            return None;
        }
        let share = self.found.len() as f32 / samples as f32;
        Some((self.replace(y), share))
    }

    /// Gives the samples that were removed from an image of `codes` the counts that bring them nearest to the values in their place
    /// in `out`.
    pub fn restore(&self, codes: Integers<'_>, range: Range, out: &mut Recovered) {
        let (peak, most) = (range.peak(), f32::from(range.max_wraps()));
        let (x, k) = out.buffers();
        for &(at, _) in &self.found {
            let y = f32::from(codes.at(at));
            let count = ((x[at] - y) / peak).round().clamp(0.0, most);
            (x[at], k[at]) = (y + count * peak, count as u8);
        }
    }

    /// Returns a copy of `y` with other codes in the place of the defects.
    fn replace(&mut self, y: &Frame) -> &Frame {
        const IN_ORDER: &str = "the samples of a frame are in standard layout";
        let sound = self.sound.get_or_insert_with(|| y.clone());
        sound.copy_from(y);
        match sound.samples_mut() {
            Samples::U8(samples) => {
                let samples = samples.as_slice_mut().expect(IN_ORDER);
                self.found.iter().for_each(|&(at, code)| samples[at] = code as u8);
            }
            Samples::U16(samples) => {
                let samples = samples.as_slice_mut().expect(IN_ORDER);
                self.found.iter().for_each(|&(at, code)| samples[at] = code);
            }
            Samples::F32(_) => unreachable!("the codes of a modulo image are integers"),
        }
        sound
    }
}

/// The loops around a sample by row and column, of which those in the middle have it as a corner; `None` beyond the border.
type Loops = [[Option<i32>; 4]; 4];

/// The pairs of neighbours among these loops of which at least one has the sample as a corner; the first one always has.
const PAIRS: [[(usize, usize); 2]; 12] = [
    [(1, 1), (0, 1)],
    [(1, 1), (1, 0)],
    [(1, 2), (0, 2)],
    [(1, 2), (1, 3)],
    [(2, 1), (3, 1)],
    [(2, 1), (2, 0)],
    [(2, 2), (3, 2)],
    [(2, 2), (2, 3)],
    [(1, 1), (1, 2)],
    [(1, 1), (2, 1)],
    [(2, 2), (1, 2)],
    [(2, 2), (2, 1)],
];

/// The number of the pairs above of which the second one does not have the sample as a corner.
const OUTWARD: usize = 8;

/// Returns what is added to a loop where 1 is added to the sample.
fn share_of_sample((i, j): (usize, usize)) -> i32 {
    match (i, j) {
        (1, 1) | (2, 2) => 1,
        (1, 2) | (2, 1) => -1,
        _ => 0,
    }
}

impl Grid {
    /// Writes the corners of all steep loops to `found`, some of them several times. Returns whether there are at most `most`; the
    /// search ends when there are more. `rows` is a buffer.
    fn find_steep<S, W>(
        self,
        samples: &[S],
        rows: &mut [Vec<W>; 2],
        most: usize,
        found: &mut Vec<usize>,
    ) -> bool
    where
        S: Copy + Into<u16>,
        W: Word,
    {
        let (stride, margin) = (self.width * self.channels, self.channels);
        let shift = W::BITS - self.range.bits();
        for row in 0..self.height {
            let codes = &mut rows[row % 2];
            codes.clear();
            let samples = &samples[row * stride..][..stride];
            widest!(codes.extend(samples.iter().map(|&sample| W::low(sample.into() << shift))));
            let Some(above) = row.checked_sub(1) else { continue };
            let (up, here) = (&rows[above % 2][..], &rows[row % 2][..]);
            let loops = stride - margin;
            // Most rows have no steep loop, nor have most parts of the others, which one pass in vectors tells.
            if !widest!(has_steep(up, here, margin, 0..loops)) {
                continue;
            }
            for from in (0..loops).step_by(PART) {
                let part = from..loops.min(from + PART);
                if !widest!(has_steep(up, here, margin, part.clone())) {
                    continue;
                }
                for l in part.filter(|&l| is_steep(up[l], up[l + margin], here[l], here[l + margin])) {
                    let first = above * stride + l;
                    found.extend([first, first + margin, first + stride, first + stride + margin]);
                }
            }
            if found.len() > most {
                return false;
            }
        }
        true
    }

    /// Returns the code that a sample should have, if it is a defect.
    fn sound_code(self, codes: Integers<'_>, at: usize) -> Option<u16> {
        let peak = 1 << self.range.bits();
        // The peak is a power of two, so that a mask gives the remainder, also that of negative numbers.
        let wrapped = |difference: i32| ((difference + peak / 2) & (peak - 1)) - peak / 2;
        let loops = self.loops(codes, at);
        // The difference of each pair, and how much of a deviation of the sample it contains; beyond the border there is none.
        let (mut pairs, mut count) = ([(0, 0); PAIRS.len()], 0);
        let (mut deviations, mut outward) = ([0; OUTWARD], 0);
        for (number, [a, b]) in PAIRS.into_iter().enumerate() {
            let (Some(first), Some(second)) = (loops[a.0][a.1], loops[b.0][b.1]) else { continue };
            let share = share_of_sample(a) - share_of_sample(b);
            (pairs[count], count) = ((first - second, share), count + 1);
            if number < OUTWARD {
                // This deviation would make the two loops equal.
                (deviations[outward], outward) = (wrapped(share * (first - second)), outward + 1);
            }
        }
        let disagreement = |deviation: i32| {
            pairs[..count]
                .iter()
                .map(|(difference, share)| wrapped(difference - share * deviation).abs())
                .sum::<i32>()
        };
        let best = deviations[..outward].iter().copied().min_by_key(|&deviation| disagreement(deviation))?;
        let is_defect = 8 * best.abs() >= LEAST_DEVIATION * peak && 2 * disagreement(best) < disagreement(0);
        if !is_defect {
            return None;
        }
        let sound = i32::from(codes.at(at)) - best;
        // Near an end of the range, the sound value may be a little beyond it. That of a neighbour is not.
        let nearest = self.beside(codes, at).min_by_key(|code| wrapped(code - sound).abs());
        let code = nearest.filter(|code| NEIGHBOUR * wrapped(code - sound).abs() <= peak).unwrap_or(sound);
        Some((code & (peak - 1)) as u16)
    }

    /// Returns the codes beside a sample, and above and below it.
    fn beside(self, codes: Integers<'_>, at: usize) -> impl Iterator<Item = i32> {
        let (stride, margin) = (self.width * self.channels, self.channels);
        let (row, sample) = (at / stride, at % stride);
        let places = [
            (sample >= margin).then(|| at - margin),
            (sample + margin < stride).then_some(at + margin),
            (row > 0).then(|| at - stride),
            (row + 1 < self.height).then_some(at + stride),
        ];
        places.into_iter().flatten().map(move |at| i32::from(codes.at(at)))
    }

    /// Returns the mixed differences, not wrapped, around a sample.
    fn loops(self, codes: Integers<'_>, at: usize) -> Loops {
        let Self { height, width, channels, .. } = self;
        let stride = width * channels;
        let (row, column, channel) = (at / stride, at % stride / channels, at % channels);
        let place =
            |at: usize, steps: usize, length: usize| (at + steps).checked_sub(2).filter(|at| at + 1 < length);
        std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let first = place(row, i, height)? * stride + place(column, j, width)? * channels + channel;
                let [right, down] = [channels, stride];
                let [a, b, c, d] =
                    [0, right, down, right + down].map(|more| i32::from(codes.at(first + more)));
                Some(a - b - c + d)
            })
        })
    }
}

/// Returns whether the mixed difference of four codes is above the limit.
#[inline(always)]
fn is_steep<W: Word>(a: W, b: W, c: W, d: W) -> bool {
    exceeds(biased(b.minus(a), d.minus(c)), STEEP)
}

/// Returns whether one of the `loops` between two rows is steep; their corners are `margin` samples apart.
#[inline(always)]
fn has_steep<W: Word>(up: &[W], here: &[W], margin: usize, loops: Indices<usize>) -> bool {
    let (from, length) = (loops.start, loops.len());
    let (a, b) = (&up[from..][..length], &up[from + margin..][..length]);
    let (c, d) = (&here[from..][..length], &here[from + margin..][..length]);
    let mut any = W::default();
    for l in 0..length {
        any = any.max(W::one_if(is_steep(a[l], b[l], c[l], d[l])));
    }
    any != W::default()
}
