//! Checks a result by itself: where a count is wrong, second differences of the radiance jump by one peak.
//!
//! Behind a lens, second differences of the true radiance are small. Around a region of wrong counts each of them is off by one
//! peak in the direction that crosses the border of the region, so that many of them exceed it.

use std::ops::Range as Indices;

use ndarray::Array3;

use super::{PROOF, Range, Recovered};
use crate::frame::{Frame, in_order};
use crate::mosaic::Mosaic;
use crate::simd::widest;

/// The second difference, in peaks, above which a pixel belongs to no region. Where true ones are at most 3/8, those at the border of
/// a region of wrong counts are off by one peak and so at least 5/8.
const BARRIER: f32 = 0.375;

/// The least share of the pixels that the largest region needs: in a more divided image no region stands out.
const LARGEST: f64 = 0.85;

/// Returns the second differences along the rows and columns of `x` above `limit` code units, per sample.
pub(super) fn share_above(x: &Array3<f32>, limit: f32) -> f32 {
    let mut count = 0;
    each_line(x, |before, here, after| count += steep(before, here, after, limit));
    count as f32 / x.len() as f32
}

/// Returns the share of the spikes of `x`: the samples that are more than half a peak above all neighbours along rows and columns, or below
/// all of them.
pub(super) fn spikes(x: &Array3<f32>, range: Range) -> f32 {
    let ((height, width, channels), half) = (x.dim(), range.peak() / 2.0);
    let (samples, stride) = (in_order(x.view()), width * channels);
    let is_spike = |&at: &usize| {
        let (row, column) = (at / stride, at % stride);
        let neighbours = [
            (row > 0).then(|| at - stride),
            (row + 1 < height).then(|| at + stride),
            (column >= channels).then(|| at - channels),
            (column + channels < stride).then(|| at + channels),
        ];
        let rise = |next: usize| samples[at] - samples[next];
        neighbours.into_iter().flatten().all(|next| rise(next) > half)
            || neighbours.into_iter().flatten().all(|next| rise(next) < -half)
    };
    (0..samples.len()).filter(is_spike).count() as f32 / samples.len() as f32
}

/// Returns the sum of the magnitudes of the second differences along the rows and columns of `x`, each counted for at most one peak, in
/// peaks per sample. Of two results for one image, the one with the lesser sum is right more often.
pub(super) fn bends(x: &Array3<f32>, range: Range) -> f64 {
    let mut sum = 0.0;
    each_line(x, |before, here, after| sum += limited(before, here, after, range.peak()));
    sum / (f64::from(range.peak()) * x.len() as f64)
}

/// Calls `line` with the samples of each row and their neighbours on both sides, left and right and then above and below.
fn each_line(x: &Array3<f32>, mut line: impl FnMut(&[f32], &[f32], &[f32])) {
    let (height, width, channels) = x.dim();
    let (samples, stride) = (in_order(x.view()), width * channels);
    for row in 0..height {
        let (above, rest) = samples.split_at(row * stride);
        let here = &rest[..stride];
        if width > 2 {
            let inner = stride - 2 * channels;
            line(&here[..inner], &here[channels..][..inner], &here[2 * channels..]);
        }
        if let Some(start) = above.len().checked_sub(2 * stride) {
            line(&above[start..][..stride], &above[start + stride..], here);
        }
    }
}

/// Returns the second differences of green along both diagonals of the mosaic `x` above one peak, per green pixel. A pixel is green
/// where the sum of its row and column is `parity`, modulo 2.
pub(super) fn share_of_green(x: &Array3<f32>, parity: usize, range: Range) -> f32 {
    let (height, width, _) = x.dim();
    let rows: Vec<&[f32]> = in_order(x.view()).chunks_exact(width).collect();
    // The pixels beside are looked at as well and count for nothing, since vectors read every pixel.
    let is_green: Vec<u32> = (0..=width as u32).map(|column| column % 2).collect();
    let (mut count, limit) = (0, range.peak());
    for (row, lines) in (1..).zip(rows.windows(3)) {
        let [above, here, below] = [lines[0], lines[1], lines[2]];
        let corners = above.iter().zip(&above[2..]).zip(below.iter().zip(&below[2..]));
        let pixels = here[1..].iter().zip(corners).zip(&is_green[(row + parity) % 2..]);
        count += widest!(pixels.fold(0, |count, ((here, corners), is_green)| {
            let (((left, right), (lower_left, lower_right)), twice) = (corners, 2.0 * here);
            let (falling, rising) = (left + lower_right - twice, right + lower_left - twice);
            count + is_green * (u32::from(falling.abs() > limit) + u32::from(rising.abs() > limit))
        }));
    }
    count as f32 / (height * width / 2) as f32
}

/// Returns the number of second differences above `limit`.
#[inline(always)]
pub(super) fn steep(before: &[f32], here: &[f32], after: &[f32], limit: f32) -> u64 {
    let samples = before.iter().zip(here).zip(after);
    let exceeds = |((before, here), after): ((&f32, &f32), &f32)| {
        u32::from((before + after - here - here).abs() > limit)
    };
    u64::from(widest!(samples.fold(0u32, |count, sample| count + exceeds(sample))))
}

/// The sums that [`limited`] runs at once; their order is the same on every machine.
const LANES: usize = 16;

/// Returns the sum of the magnitudes of the second differences, each at most `limit`.
fn limited(before: &[f32], here: &[f32], after: &[f32], limit: f32) -> f64 {
    let bend = |before: f32, here: f32, after: f32| (before + after - here - here).abs().min(limit);
    let mut sums = [0.0; LANES];
    let ((before_lanes, rest_before), (here_lanes, rest), (after_lanes, rest_after)) =
        (before.as_chunks::<LANES>(), here.as_chunks::<LANES>(), after.as_chunks::<LANES>());
    widest!(for ((before, here), after) in before_lanes.iter().zip(here_lanes).zip(after_lanes) {
        for lane in 0..LANES {
            sums[lane] += bend(before[lane], here[lane], after[lane]);
        }
    });
    let rest = rest_before.iter().zip(rest).zip(rest_after);
    let rest: f32 = rest.map(|((&before, &here), &after)| bend(before, here, after)).sum();
    f64::from(rest) + sums.into_iter().map(f64::from).sum::<f64>()
}

impl Recovered {
    /// Returns a confidence image, H x W x 1 of 8 bits: 255 where the counts are claimed to be right, 0 elsewhere.
    /// `mosaic` is that of the modulo image.
    ///
    /// Where counts are proved, also those of a part of the image, the claim is that of the pixels of which all counts are.
    /// Else the pixels at which no second difference is above 3/8 of the peak form regions; the counts of the largest one are claimed to be right if it has at
    /// least 85 % of the pixels. In a mosaic, 2 x 2 pixels count as one, with neighbours of the same colours. Behind a lens
    /// of 0.8 px and more, hardly a count in it is wrong (docs/research/trust.md); behind a sharper one an error may leave no trace.
    ///
    /// # Panics
    /// If the radiance is left out: [`Recovered::fill`] has to come before.
    pub fn confidence(&self, mosaic: Option<Mosaic>, range: Range) -> Frame {
        let (height, width, channels) = self.k.dim();
        let mut proved = self.proved.clone();
        if self.report.method == PROOF {
            proved.resize(height * width, u8::MAX);
            self.defects.iter().for_each(|at| proved[at / channels] = 0);
        }
        if !proved.is_empty() {
            let confidence = Array3::from_shape_vec((height, width, 1), proved);
            let confidence = confidence.expect("the claim is one of each pixel");
            return Frame::from_u8(confidence).expect("the result has the shape of an image");
        }
        let cell = if mosaic.is_some() { 2 } else { 1 };
        let (rows, columns) = (height.div_ceil(cell), width.div_ceil(cell));
        let mut regions = Regions::default();
        regions.find(&self.x, cell, range);
        let mut confidence = Array3::zeros((height, width, 1));
        // In a divided image, no region can be told to be the right one.
        if regions.largest().map(|run| run.len()).sum::<usize>() as f64 >= LARGEST * (rows * columns) as f64 {
            let pixels = confidence.as_slice_mut().expect("the array was just made");
            for run in regions.largest() {
                let (row, column) = (run.start / columns * cell, run.start % columns * cell);
                for row in row..height.min(row + cell) {
                    pixels[row * width..][..width][column..width.min(column + run.len() * cell)]
                        .fill(u8::MAX);
                }
            }
        }
        Frame::from_u8(confidence).expect("the result has the shape of an image")
    }
}

/// Finds the largest region of pixels at which no second difference is above the barrier; with its buffers.
#[derive(Default)]
pub(super) struct Regions {
    /// Whether a cell may belong to a region.
    free: Vec<bool>,
    barred: Vec<bool>,
    /// The free places of each row that are neighbours.
    runs: Vec<Indices<usize>>,
    /// For each run an earlier run of its region; the first run of a region has itself.
    earlier: Vec<usize>,
    /// The number of places by the first run of a region.
    sizes: Vec<usize>,
    /// The first run of the largest region.
    first: Option<usize>,
}

impl Regions {
    /// Finds the largest region of cells of `cell` x `cell` pixels of `x`.
    pub fn find(&mut self, x: &Array3<f32>, cell: usize, range: Range) {
        self.free_cells(x, cell, range);
        self.join(x.dim().1.div_ceil(cell));
    }

    /// Returns the largest region as the runs of its rows, in the order of the cells; if several regions have this size, the one that
    /// begins first.
    pub fn largest(&self) -> impl Iterator<Item = Indices<usize>> {
        let is_largest = |run: &usize| Some(root(&self.earlier, *run)) == self.first;
        (0..self.runs.len()).filter(is_largest).map(|run| self.runs[run].clone())
    }

    /// Finds the cells in which no second difference is above the barrier.
    fn free_cells(&mut self, x: &Array3<f32>, cell: usize, range: Range) {
        let Self { free, barred, .. } = self;
        let (height, width, channels) = x.dim();
        let (columns, limit, stride) = (width.div_ceil(cell), BARRIER * range.peak(), width * channels);
        let x = x.as_standard_layout();
        let samples = in_order(x.view());
        let at = |row: usize| &samples[row * stride..][..stride];
        free.clear();
        free.resize(height.div_ceil(cell) * columns, true);
        // In a mosaic, the next pixel of the same colour is two pixels away.
        let step = cell * channels;
        barred.resize(stride, false);
        for row in 0..height {
            barred.fill(false);
            if width > 2 * cell {
                let inner = &mut barred[step..stride - step];
                bar(inner, at(row), &at(row)[step..], &at(row)[2 * step..], limit);
            }
            if row >= cell && row + cell < height {
                bar(barred, at(row - cell), at(row), at(row + cell), limit);
            }
            let line = &mut free[row / cell * columns..][..columns];
            widest!(for (free, barred) in line.iter_mut().zip(barred.chunks(step)) {
                *free &= !barred.iter().fold(false, |any, barred| any | barred);
            });
        }
    }

    /// Joins the free places of rows of `columns` places to regions.
    fn join(&mut self, columns: usize) {
        let Self { free, runs, earlier, sizes, .. } = self;
        runs.clear();
        earlier.clear();
        sizes.clear();
        // Reserved for the worst case, so that no later image of this size allocates.
        runs.reserve(free.len());
        earlier.reserve(free.len());
        sizes.reserve(free.len());
        let mut above = 0;
        for (row, line) in free.chunks_exact(columns).enumerate() {
            let (first, mut at) = (runs.len(), row * columns);
            for places in line.chunk_by(|a, b| a == b) {
                if places[0] {
                    earlier.push(runs.len());
                    runs.push(at..at + places.len());
                }
                at += places.len();
            }
            for here in first..runs.len() {
                let run = runs[here].clone();
                above +=
                    runs[above..first].iter().take_while(|upper| upper.end + columns <= run.start).count();
                // The last of them may also touch the next run.
                for upper in (above..first).take_while(|&upper| runs[upper].start + columns < run.end) {
                    unite(earlier, upper, here);
                }
            }
            above = first;
        }
        sizes.resize(runs.len(), 0);
        for (at, run) in runs.iter().enumerate() {
            sizes[root(earlier, at)] += run.len();
        }
        self.first = (0..runs.len()).rev().max_by_key(|&run| sizes[run]);
    }
}

/// Marks in `barred` where a second difference is above `limit`.
fn bar(barred: &mut [bool], before: &[f32], here: &[f32], after: &[f32], limit: f32) {
    widest!(for (((barred, before), here), after) in barred.iter_mut().zip(before).zip(here).zip(after) {
        *barred |= (before + after - here - here).abs() > limit;
    });
}

/// Makes one region of those of two runs.
fn unite(earlier: &mut [usize], upper: usize, here: usize) {
    let roots = [upper, here].map(|run| root(earlier, run));
    // The ways to the first run are shortened, too.
    for run in [roots[0], roots[1], upper, here] {
        earlier[run] = roots[0].min(roots[1]);
    }
}

/// Returns the first run of the region of `run`.
fn root(earlier: &[usize], mut run: usize) -> usize {
    while earlier[run] != run {
        run = earlier[run];
    }
    run
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn what_is_proved_is_claimed_and_nothing_else() {
        let mut out = result((8, 8, 3), None);
        (out.report.method, out.defects) = (PROOF, vec![5, 30]);
        let claims = |out: &Recovered| -> Vec<u8> {
            out.confidence(None, range()).to_f32().iter().map(|&claim| claim as u8).collect()
        };
        let expected: Vec<u8> = (0..64).map(|at| if [1, 10].contains(&at) { 0 } else { 255 }).collect();
        assert_eq!(claims(&out), expected);
        // A part that is proved replaces what second differences would claim.
        out = Recovered { proved: expected.clone(), ..result((8, 8, 3), None) };
        assert_eq!(claims(&out), expected);
    }

    const RANGE: (u8, f64) = (8, 4.0);

    fn range() -> Range {
        Range::new(RANGE.0, RANGE.1).unwrap()
    }

    /// A smooth result, in which the counts of a square are one too high.
    fn result(dim: (usize, usize, usize), square: Option<usize>) -> Recovered {
        let inside = |at: usize| square.is_some_and(|side| (20..20 + side).contains(&at));
        let x = Array3::from_shape_fn(dim, |(i, j, c)| {
            let smooth = 300.0 + 200.0 * ((i as f32 / 30.0).sin() + (j as f32 / 40.0 + c as f32).cos());
            smooth + if inside(i) && inside(j) { 256.0 } else { 0.0 }
        });
        Recovered { k: Array3::zeros(dim), x, ..Recovered::default() }
    }

    proptest! {
        #[test]
        fn counts_and_sums_second_differences(
            (height, width, rgb) in (1usize..6, 1usize..40, any::<bool>()), seed in any::<u64>(),
        ) {
            let mut random = seed | 1;
            let dim = (height, width, if rgb { 3 } else { 1 });
            let x = Array3::from_shape_simple_fn(dim, || {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                ((random >> 40) % 1024) as f32
            });
            let (mut count, mut sum) = (0, 0.0);
            for (i, j, c) in ndarray::indices(dim) {
                let second = |a: f32, b: f32| (a + b - 2.0 * x[(i, j, c)]).abs();
                let along = (j > 0 && j + 1 < width).then(|| second(x[(i, j - 1, c)], x[(i, j + 1, c)]));
                let across = (i > 0 && i + 1 < height).then(|| second(x[(i - 1, j, c)], x[(i + 1, j, c)]));
                for bend in [along, across].into_iter().flatten() {
                    count += u32::from(bend > 256.0);
                    sum += f64::from(bend.min(256.0)) / 256.0;
                }
            }
            prop_assert_eq!(share_above(&x, range().peak()), count as f32 / x.len() as f32);
            prop_assert!((bends(&x, range()) - sum / x.len() as f64).abs() < 1e-9);
        }
    }

    #[test]
    fn a_square_of_wrong_counts_is_seen_and_not_claimed_to_be_right() {
        for (channels, mosaic) in [(3, None), (1, None), (1, Some(Mosaic::Gbrg))] {
            let dim = (90, 120, channels);
            let right = result(dim, None);
            assert_eq!(share_above(&right.x, range().peak()), 0.0);
            let all = right.confidence(mosaic, range());
            assert!(all.as_u8().unwrap().iter().all(|&value| value == 255));
            let wrong = result(dim, Some(24));
            let confidence = wrong.confidence(mosaic, range());
            let confidence = confidence.as_u8().unwrap();
            let inside = |at: usize| (20..44).contains(&at);
            assert!(
                confidence.indexed_iter().all(|((i, j, _), &value)| value == 0 || !inside(i) || !inside(j))
            );
            assert!(confidence.iter().filter(|value| **value == 255).count() > 90 * 120 - 30 * 30);
        }
    }

    /// Returns the largest region by its definition: each place takes the least number of its free neighbours until none changes.
    fn largest_by_numbers(free: &[bool], columns: usize) -> Vec<usize> {
        let mut numbers: Vec<usize> = (0..free.len()).collect();
        loop {
            let before = numbers.clone();
            for (a, b) in (0..free.len()).flat_map(|at| [(at, at + 1), (at, at + columns)]) {
                let is_row = b == a + columns || b % columns > 0;
                if is_row && b < free.len() && free[a] && free[b] {
                    let least = numbers[a].min(numbers[b]);
                    (numbers[a], numbers[b]) = (least, least);
                }
            }
            if numbers == before {
                break;
            }
        }
        let places =
            |number: usize| (0..free.len()).filter(|&at| free[at] && numbers[at] == number).collect();
        let regions = (0..free.len()).map(places);
        regions.rev().max_by_key(Vec::len).expect("there is a place")
    }

    proptest! {
        #[test]
        fn the_largest_region_is_that_of_its_definition(
            columns in 1usize..12, rows in 1usize..12, bits: [u64; 3], is_dense: bool,
        ) {
            let bit = |word: u64, at: usize| word.rotate_right(at as u32 * 7) & 1 == 1;
            let free: Vec<bool> = (0..rows * columns)
                .map(|at| bit(bits[at % 3], at) || (is_dense && bit(bits[(at + 1) % 3], at)))
                .collect();
            let mut regions = Regions { free, ..Regions::default() };
            regions.join(columns);
            let region: Vec<usize> = regions.largest().flatten().collect();
            prop_assert_eq!(region, largest_by_numbers(&regions.free, columns));
        }
    }

    #[test]
    fn a_divided_image_is_not_claimed_to_be_right() {
        // Stripes as wide as three pixels, of which every second one is two peaks brighter.
        let x = Array3::from_shape_fn((60, 60, 1), |(i, ..)| if i / 3 % 2 == 0 { 10.0 } else { 522.0 });
        let out = Recovered { k: Array3::zeros(x.dim()), x, ..Recovered::default() };
        assert!(out.confidence(None, range()).as_u8().unwrap().iter().all(|&value| value == 0));
    }
}
