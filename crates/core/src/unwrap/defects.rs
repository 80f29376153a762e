//! Finds hot, dead and stuck samples in y, which contradict all their neighbours, and leaves them out of the unwrapping.
//!
//! Behind a lens, the mixed differences of y change little from one 2 x 2 loop to the next, even at a steep edge. A sample that is off by
//! d adds d to two of its four loops and takes d from the other two. So it is a defect if another value of it makes these loops agree
//! with each other and with the eight loops beside them: if the sum of `|M_b(m - m')|` over all pairs of neighbours falls to less than
//! half. Only the corners of steep loops are looked at, since no other sample can do harm.
//!
//! In a colour mosaic, the neighbours of a green sample are the four green ones diagonally beside it. Red and blue ones are two pixels apart,
//! too far for edges. So their differences from the green beside them are searched, which change little where the scene does.
//!
//! A defect is replaced by that value, y is unwrapped, and then the defect gets the count that brings it nearest to the value that was
//! found in its place. So it takes part in no vote, tree or quality metric.

use super::wrapped::{Word, exceeds};
use super::{Integers, Range, Recovered};
use crate::Mosaic;
use crate::frame::{Frame, Samples};
use crate::mosaic::mirrored;
use crate::simd::widest;

/// The largest share of the samples that are taken for defects. The count of every second defect differs from that of its neighbours,
/// so that with this share 0.015 % of the counts are wrong. An image with more is sharp, or noisy.
const MOST: f64 = 3e-4;

/// The least deviation of a defect, in eighths of the peak.
const LEAST_DEVIATION: i32 = 1;

/// A defect gets the code of a neighbour from which its sound value differs by at most this part of the peak.
const NEIGHBOUR: i32 = 32;

/// The limit of a steep mixed difference in sixteenths of the peak, as in the quality metrics.
const STEEP: u16 = 6;

/// Samples that are looked at for each one that may be a defect: a defect in a flat part of the image is a corner of four steep loops,
/// which have nine corners.
const CANDIDATES: usize = 10;

/// The largest spread of the green samples around a red or blue one, in sixteenths of the peak, with which their mean is taken for right. From
/// half a peak on, it may be half a peak off.
const CLEAR: i32 = 7;

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
    bytes: Rows<i8>,
    words: Rows<i16>,
    /// The samples of green in a mosaic, and the differences of the others from it.
    planes: [Vec<u16>; 2],
}

/// The last rows of an image: row i lies at i modulo 3.
type Rows<W> = [Vec<W>; 3];

/// The green samples beside one of another colour: to the left and to the right, above and below.
#[derive(Clone, Copy)]
struct Beside([i32; 4]);

impl Beside {
    /// Returns the mean of the two to both sides, or of those above and below, whichever differ less.
    #[inline(always)]
    fn mean(self, range: Range) -> u16 {
        let Self([left, right, above, below]) = self;
        let (along, across) = (wrapped(right - left, range), wrapped(below - above, range));
        let mean = if across.abs() < along.abs() { above + across / 2 } else { left + along / 2 };
        (mean & ((1 << range.bits()) - 1)) as u16
    }

    /// Returns whether all four are so near to each other that the mean cannot be half a peak off.
    fn is_clear(self, range: Range) -> bool {
        let from_first = self.0.map(|code| wrapped(code - self.0[0], range));
        let [least, most] = [i32::min, i32::max].map(|pick| from_first.into_iter().fold(0, pick));
        16 * (most - least) <= CLEAR << range.bits()
    }
}

/// Wraps a difference to half a peak on both sides of 0. The peak is a power of two, so that a mask gives the remainder, also that of
/// negative numbers.
#[inline(always)]
fn wrapped(difference: i32, range: Range) -> i32 {
    let peak = 1 << range.bits();
    ((difference + peak / 2) & (peak - 1)) - peak / 2
}

/// The layout of the samples of an image.
#[derive(Clone, Copy)]
struct Grid {
    height: usize,
    width: usize,
    channels: usize,
    /// The steps to the neighbours in two directions: rows down, and columns to the right.
    steps: [Step; 2],
    range: Range,
}

/// Rows down, and columns to the right.
type Step = (usize, isize);

/// The steps to the neighbours of a sample in its row and its column.
const BESIDE: [Step; 2] = [(0, 1), (1, 0)];

/// The steps to the nearest samples of green in a mosaic.
const DIAGONALLY: [Step; 2] = [(1, 1), (1, -1)];

/// The steps to the nearest samples of red and of blue.
const TWO_APART: [Step; 2] = [(0, 2), (2, 0)];

impl Defects {
    /// Returns `y` without its defects, and their share of the samples; `None` if it has none, or too many to be defects.
    pub fn remove(&mut self, y: &Frame, codes: Integers<'_>, range: Range) -> Option<(&Frame, f32)> {
        let (height, width, channels) = y.dim();
        let (grid, samples) =
            (Grid { height, width, channels, steps: BESIDE, range }, height * width * channels);
        let most = (MOST * samples as f64) as usize;
        self.found.clear();
        // Reserved at once, so that no later frame of this size allocates.
        self.found.reserve(most + 1);
        let few = match y.mosaic() {
            None => self.search(codes, grid, most),
            Some(mosaic) => self.search_mosaic(codes, mosaic, grid, most),
        };
        if !few || self.found.is_empty() {
            self.found.clear();
            return None;
        }
        let share = self.found.len() as f32 / samples as f32;
        Some((self.replace(y), share))
    }

    /// Adds the defects among the samples `codes` to those that were found, in ascending order. Returns whether there are at most `most` in
    /// all.
    fn search(&mut self, codes: Integers<'_>, grid: Grid, most: usize) -> bool {
        let Self { candidates, found, bytes, words, .. } = self;
        candidates.clear();
        candidates.reserve(CANDIDATES * most + 4 * grid.width * grid.channels);
        let few = match codes {
            Integers::U8(codes) => grid.find_steep(codes, bytes, CANDIDATES * most, candidates),
            Integers::U16(codes) => grid.find_steep(codes, words, CANDIDATES * most, candidates),
        };
        if few {
            candidates.sort_unstable();
            candidates.dedup();
            let defects = candidates.iter().filter_map(|&at| Some((at, grid.sound_code(codes, at)?)));
            found.extend(defects.take(most + 1));
        }
        few && found.len() <= most
    }

    /// Searches a colour mosaic: green, and then red and blue by their differences from green. Other samples are set to 0, which makes their
    /// loops flat.
    fn search_mosaic(&mut self, codes: Integers<'_>, mosaic: Mosaic, grid: Grid, most: usize) -> bool {
        let (width, range) = (grid.width, grid.range);
        let peak_mask = ((1u32 << range.bits()) - 1) as u16;
        // Every second sample of a row is green.
        let is_green = |at: usize| mosaic.channel(at / width, at % width) == 1;
        let of_green = |row: usize| usize::from(!is_green(row * width));
        let every_second: Vec<u16> = (0..=width).map(|column| (column % 2) as u16).collect();
        let [mut green, mut colour] = std::mem::take(&mut self.planes);
        codes.widen(&mut green);
        for (row, codes) in green.chunks_exact_mut(width).enumerate() {
            let places = codes.iter_mut().zip(&every_second[1 - of_green(row)..]);
            widest!(places.for_each(|(code, kept)| *code *= kept));
        }
        let mut few = self.search(Integers::U16(&green), Grid { steps: DIAGONALLY, ..grid }, most);
        self.found.iter().for_each(|&(at, code)| green[at] = code);
        let greens = self.found.len();
        codes.widen(&mut colour);
        for (row, codes) in colour.chunks_exact_mut(width).enumerate() {
            grid.take_from(codes, &green, row);
            let places = codes.iter_mut().zip(&every_second[of_green(row)..]);
            widest!(places.for_each(|(code, kept)| *code *= kept));
        }
        let of_colour = Grid { steps: TWO_APART, ..grid };
        few &= self.search(Integers::U16(&colour), of_colour, most);
        for (at, code) in &mut self.found[greens..] {
            *code = code.wrapping_add(grid.beside(&green, *at).mean(range)) & peak_mask;
        }
        // Where green changes by more than half a peak, a mean is half a peak off, as a defect would be, and so it looks from beside.
        let around = |at: usize| (0..9).filter_map(move |n| of_colour.place(at, n % 3 - 1, n / 3 - 1));
        let is_clear = |at| grid.beside(&green, at).is_clear(range);
        self.found.retain(|&(at, _)| is_green(at) || around(at).all(is_clear));
        self.found.sort_unstable();
        self.planes = [green, colour];
        few
    }

    /// Gives the samples that were removed from an image of `codes` the counts that bring them nearest to the values in their place
    /// in `out`.
    pub fn restore(&self, codes: Integers<'_>, range: Range, out: &mut Recovered) {
        out.defects.extend(self.found.iter().map(|(at, _)| at));
        let (x, k) = out.buffers();
        for &(at, sound) in &self.found {
            let restored =
                range.nearest(codes.at(at).into(), f32::from(sound) + f32::from(k[at]) * range.peak());
            k[at] = restored.1;
            if let Some(x) = x.get_mut(at) {
                *x = restored.0;
            }
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
    fn find_steep<S, W>(self, samples: &[S], rows: &mut Rows<W>, most: usize, found: &mut Vec<usize>) -> bool
    where
        S: Copy + Into<u16>,
        W: Word,
    {
        let (stride, channels) = (self.width * self.channels, self.channels);
        let corners = self.corners();
        let (deepest, widest) = (corners[3].0, corners.iter().fold(0, |most, corner| corner.1.max(most)));
        let shift = W::BITS - self.range.bits();
        for row in 0..self.height {
            let codes = &mut rows[row % 3];
            codes.clear();
            let samples = &samples[row * stride..][..stride];
            widest!(codes.extend(samples.iter().map(|&sample| W::low(sample.into() << shift))));
            let (Some(top), Some(loops)) = (row.checked_sub(deepest), stride.checked_sub(widest * channels))
            else {
                continue;
            };
            let [a, b, c, d] =
                corners.map(|(down, right)| &rows[(top + down) % 3][right * channels..][..loops]);
            // Most rows have no steep loop, nor have most parts of the others, which one pass in vectors tells.
            if widest!(has_steep(a, b, c, d)) {
                for at in steep_loops([a, b, c, d]) {
                    let first = top * stride + at;
                    found.extend(corners.map(|(down, right)| first + down * stride + right * channels));
                }
            }
            if found.len() > most {
                return false;
            }
        }
        true
    }

    /// Returns the corners of a loop: rows below the first one, and columns to the right of the leftmost one.
    fn corners(self) -> [(usize, usize); 4] {
        let [(a, right), (b, left)] = self.steps;
        let columns = [0, right, left, right + left];
        let leftmost = columns.iter().fold(0, |least, column| least.min(*column));
        let [first, second, third, fourth] = columns.map(|column| (column - leftmost).cast_unsigned());
        [(0, first), (a, second), (b, third), (a + b, fourth)]
    }

    /// Returns the index of the sample `right` and `down` steps from the one at `at`; `None` beyond the border.
    fn place(self, at: usize, right: isize, down: isize) -> Option<usize> {
        let Self { height, width, channels, steps: [a, b], .. } = self;
        let (pixel, channel) = (at / channels, at % channels);
        let rows = right * a.0.cast_signed() + down * b.0.cast_signed();
        let row = (pixel / width).checked_add_signed(rows).filter(|row| *row < height)?;
        let column = (pixel % width).checked_add_signed(right * a.1 + down * b.1).filter(|at| *at < width)?;
        Some((row * width + column) * channels + channel)
    }

    /// Takes the mean of `green` beside it from each code of a row of a mosaic.
    fn take_from(self, codes: &mut [u16], green: &[u16], row: usize) {
        let (range, last) = (self.range, self.width - 1);
        let mask = ((1u32 << range.bits()) - 1) as u16;
        let line = |row: usize| &green[row * self.width..][..self.width];
        let [above, below] = self.rows_beside(row).map(line);
        let neighbours =
            line(row).iter().zip(&line(row)[2..]).zip(above[1..last].iter().zip(&below[1..last]));
        widest!(codes[1..last].iter_mut().zip(neighbours).for_each(
            |(code, ((left, right), (above, below)))| {
                let beside = Beside([*left, *right, *above, *below].map(i32::from));
                *code = code.wrapping_sub(beside.mean(range)) & mask;
            }
        ));
        for column in [0, last] {
            let mean = self.beside(green, row * self.width + column).mean(range);
            codes[column] = codes[column].wrapping_sub(mean) & mask;
        }
    }

    /// Returns the codes beside a sample of a mosaic. Beyond the border lies the mirror image without the border pixel.
    fn beside(self, codes: &[u16], at: usize) -> Beside {
        let (row, column) = (at / self.width, at % self.width);
        let code = |row: usize, column: usize| i32::from(codes[row * self.width + column]);
        let [left, right] = [-1, 1].map(|right| mirrored(column.cast_signed() + right, self.width));
        let [above, below] = self.rows_beside(row);
        Beside([code(row, left), code(row, right), code(above, column), code(below, column)])
    }

    /// Returns the rows above and below a row of a mosaic.
    fn rows_beside(self, row: usize) -> [usize; 2] {
        [-1, 1].map(|down| mirrored(row.cast_signed() + down, self.height))
    }

    /// Returns the code that a sample should have, if it is a defect.
    fn sound_code(self, codes: Integers<'_>, at: usize) -> Option<u16> {
        let peak = 1 << self.range.bits();
        let wrapped = |difference: i32| wrapped(difference, self.range);
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
        let nearest = self.four_around(codes, at).min_by_key(|code| wrapped(code - sound).abs());
        let code = nearest.filter(|code| NEIGHBOUR * wrapped(code - sound).abs() <= peak).unwrap_or(sound);
        Some((code & (peak - 1)) as u16)
    }

    /// Returns the codes of the four neighbours of a sample.
    fn four_around(self, codes: Integers<'_>, at: usize) -> impl Iterator<Item = i32> {
        let places = [(-1, 0), (1, 0), (0, -1), (0, 1)].map(|(right, down)| self.place(at, right, down));
        places.into_iter().flatten().map(move |at| i32::from(codes.at(at)))
    }

    /// Returns the mixed differences, not wrapped, around a sample.
    fn loops(self, codes: Integers<'_>, at: usize) -> Loops {
        let code = |right, down| self.place(at, right, down).map(|at| i32::from(codes.at(at)));
        [-2, -1, 0, 1].map(|down| {
            [-2, -1, 0, 1].map(|right| {
                let [a, b] = [code(right, down)?, code(right + 1, down)?];
                Some(a - b - code(right, down + 1)? + code(right + 1, down + 1)?)
            })
        })
    }
}

/// Returns whether the mixed difference of four codes is above the limit.
#[inline(always)]
fn is_steep<W: Word>(a: W, b: W, c: W, d: W) -> bool {
    exceeds(d.minus(c).minus(b.minus(a)), STEEP)
}

/// Returns the indices of the steep loops with these corners.
fn steep_loops<W: Word>(corners: [&[W]; 4]) -> impl Iterator<Item = usize> {
    let loops = corners[0].len();
    let parts = (0..loops)
        .step_by(PART)
        .map(move |from| (from, corners.map(|codes| &codes[from..loops.min(from + PART)])));
    parts.filter(|(_, [a, b, c, d])| widest!(has_steep(a, b, c, d))).flat_map(|(from, [a, b, c, d])| {
        (0..a.len()).filter(move |&l| is_steep(a[l], b[l], c[l], d[l])).map(move |l| from + l)
    })
}

/// Returns whether one of the loops with these corners is steep.
#[inline(always)]
fn has_steep<W: Word>(a: &[W], b: &[W], c: &[W], d: &[W]) -> bool {
    let length = a.len();
    let (b, c, d) = (&b[..length], &c[..length], &d[..length]);
    let mut any = W::default();
    for l in 0..length {
        any = any.max(W::one_if(is_steep(a[l], b[l], c[l], d[l])));
    }
    any != W::default()
}
