//! [`Plane`]: the radiance of an image and which of its counts are proved, and the sweeps that prove more of them.
//!
//! A sweep goes over the rows or the columns, forward or backward. A sample with [`RUN`] proved ones behind it is proved where the stencils leave it
//! one count. All samples of a row are taken at once, and those of a column in some rows, so that the processor has many that do not depend on
//! each other. Beyond the border, the image is mirrored, as the scene is.

use std::collections::VecDeque;

use super::stencil::{Family, RADIUS, RUN, Stencil};
use crate::simd::widest;

/// The samples that are looked at together. The rows of the plane are filled up to whole chunks.
const CHUNK: usize = 16;

/// The samples of a column that are taken at once: of 16 rows with three channels, or of 48 with one.
const LANES: usize = 3 * CHUNK;

/// Why a stencil has as many weights.
const IS_RUN: &str = "lines are swept with the stencils of a run";

/// The image, row-major and interleaved.
#[derive(Default)]
pub(super) struct Plane {
    height: usize,
    width: usize,
    channels: usize,
    stride: usize,
    /// The radiance in peaks: the middle of the code, and the count where it is proved.
    x: Vec<f32>,
    /// 1 where the count is proved, else 0.
    known: Vec<u8>,
}

/// What leaves one count: the stencils, and the greatest count of the sensor.
#[derive(Clone, Copy)]
pub(super) struct Rule<'a> {
    pub family: &'a Family,
    pub most: f32,
}

impl Plane {
    /// Reads `codes` (H x W x C, interleaved) of this peak. The counts of the first `seeds` columns are 0.
    pub fn read<T: Copy + Into<f32>>(
        &mut self,
        codes: &[T],
        (height, width, channels): (usize, usize, usize),
        peak: f32,
        seeds: usize,
    ) {
        let (line, per_peak) = (width * channels, peak.recip());
        self.stride = line.next_multiple_of(CHUNK);
        (self.height, self.width, self.channels) = (height, width, channels);
        self.x.resize(height * self.stride, 0.0);
        // What fills the rows up is never looked at.
        self.known.clear();
        self.known.resize(height * self.stride, 1);
        let rows = self.x.chunks_exact_mut(self.stride).zip(self.known.chunks_exact_mut(self.stride));
        for ((x, known), codes) in rows.zip(codes.chunks_exact(line)) {
            widest!(x.iter_mut().zip(codes).for_each(|(x, code)| *x = ((*code).into() + 0.5) * per_peak));
            known[seeds * channels..line].fill(0);
        }
    }

    /// Writes the counts to `k` (H x W x C, interleaved).
    pub fn write(&self, k: &mut [u8]) {
        let line = self.width * self.channels;
        for (x, k) in self.x.chunks_exact(self.stride).zip(k.chunks_exact_mut(line)) {
            widest!(k.iter_mut().zip(x).for_each(|(k, x)| *k = *x as u8));
        }
    }

    /// Returns for each sample (H x W x C, interleaved) whether its count is proved.
    pub fn proved(&self) -> impl Iterator<Item = bool> {
        let line = self.width * self.channels;
        self.known.chunks_exact(self.stride).flat_map(move |row| row[..line].iter().map(|&known| known == 1))
    }

    /// Returns the number of the counts that are not proved.
    pub fn unknown(&self) -> usize {
        let known = widest!(self.known.iter().fold(0, |sum, &known| sum + u32::from(known)));
        self.known.len() - known as usize
    }

    /// Sweeps over the rows, down or up.
    pub fn over_rows(&mut self, rule: Rule<'_>, is_up: bool) {
        let Self { height, stride, x, known, .. } = self;
        let mut runs = vec![0; *stride];
        for step in 0..*height {
            let row = if is_up { *height - 1 - step } else { step };
            let (begin, end) = (row * *stride, (row + 1) * *stride);
            // Those behind a row lie before it, or after it where the sweep goes up.
            let (before, rest) = x.split_at_mut(if is_up { end } else { begin });
            let (behind, x, first) =
                if is_up { (&*rest, &mut before[begin..], end) } else { (&*before, &mut rest[..*stride], 0) };
            let last = |earlier: usize| {
                let row = if is_up { *height - 1 - earlier } else { earlier };
                &behind[row * *stride - first..][..*stride]
            };
            let lines = (step > 0).then(|| mirrored(step).map(last));
            widest!(prove(rule, lines, step, x, &mut known[begin..end], &mut runs));
        }
    }

    /// Sweeps over the columns, to the right or to the left.
    pub fn over_columns(&mut self, rule: Rule<'_>, is_left: bool) {
        let rows = LANES / self.channels;
        for first in (0..self.height).step_by(rows) {
            let rows = rows.min(self.height - first);
            let range = first * self.stride..(first + rows) * self.stride;
            let (x, known) = (&mut self.x[range.clone()], &mut self.known[range]);
            if known.contains(&0) {
                let shape = (self.width, self.stride);
                match self.channels {
                    1 => widest!(columns::<1>(rule, (x, known), shape, is_left)),
                    _ => widest!(columns::<3>(rule, (x, known), shape, is_left)),
                }
            }
        }
    }

    /// Proves samples by those around them, as long as there are any. A sample is looked at again where one beside it was proved.
    pub fn fill(&mut self, families: &[Family], most: f32) {
        let mut open: VecDeque<usize> = (0..self.x.len()).filter(|&at| self.known[at] == 0).collect();
        let mut is_open: Vec<bool> = self.known.iter().map(|&known| known == 0).collect();
        while let Some(at) = open.pop_front() {
            is_open[at] = false;
            let Some(count) = self.count_by(families, at, most) else { continue };
            self.x[at] += count;
            self.known[at] = 1;
            for way in [self.channels, self.stride] {
                for at in [at.wrapping_sub(way), at + way] {
                    if self.known.get(at) == Some(&0) && !is_open[at] {
                        is_open[at] = true;
                        open.push_back(at);
                    }
                }
            }
        }
    }

    /// Returns the count of a sample, if those around it leave one. Beyond the border, the image is mirrored.
    fn count_by(&self, families: &[Family], at: usize, most: f32) -> Option<f32> {
        let Self { x, known, stride, channels, height, width } = self;
        let (row, column) = (at / stride, at % stride / channels);
        let inside = |at: usize, size: usize| at >= RADIUS && at + RADIUS < size;
        let is_inside = inside(row, *height) && inside(column, *width);
        let place = |&[down, right]: &[isize; 2]| {
            let (down, right) = match is_inside {
                true => (down, right),
                false => (mirrored_way(row, down, *height), mirrored_way(column, right, *width)),
            };
            at.wrapping_add_signed(down * stride.cast_signed() + right * channels.cast_signed())
        };
        // The nearest ones come last in most families.
        let mut ready =
            families.iter().filter(|family| family.places.iter().rev().all(|way| known[place(way)] == 1));
        ready.find_map(|family| {
            one_count(Rule { family, most }, x[at], family.places.iter().map(|way| x[place(way)]))
        })
    }

    /// Returns whether each sample is one that some scene can give with those above it.
    pub fn is_possible(&self, stencil: &Stencil) -> bool {
        let line = |row: usize| &self.x[row * self.stride..][..self.width * self.channels];
        (RUN / 2..self.height).all(|row| widest!(are_possible(mirrored(row).map(line), line(row), stencil)))
    }
}

/// Returns the steps of a sweep that lie behind this one (> 0), the farthest first.
fn mirrored(step: usize) -> [usize; RUN] {
    std::array::from_fn(|at| {
        let back = RUN - at;
        step.checked_sub(back).unwrap_or_else(|| (back - step - 1).min(step - 1))
    })
}

/// Returns the way to the sample of a line of `size` that takes the place of the one `way` away, beyond the border the mirrored one.
fn mirrored_way(at: usize, way: isize, size: usize) -> isize {
    let (at, size) = (at.cast_signed(), size.cast_signed());
    let place = if at + way < 0 { -1 - at - way } else { at + way };
    let place = if place >= size { 2 * size - 1 - place } else { place };
    place.clamp(0, size - 1) - at
}

/// Sweeps over the columns of some rows.
#[inline(always)]
fn columns<const C: usize>(
    rule: Rule<'_>,
    (x, known): (&mut [f32], &mut [u8]),
    (width, stride): (usize, usize),
    is_left: bool,
) {
    let rows = x.len() / stride;
    let mut last = [[0.0; LANES]; RUN];
    let mut runs = [0; LANES];
    for step in 0..width {
        let first = C * if is_left { width - 1 - step } else { step };
        let (mut here, mut is_known) = ([0.0; LANES], [1; LANES]);
        for row in 0..rows {
            let (x, known) = (&x[row * stride + first..], &known[row * stride + first..]);
            here[row * C..][..C].copy_from_slice(&x[..C]);
            is_known[row * C..][..C].copy_from_slice(&known[..C]);
        }
        let was_known = is_known;
        let lines = (step > 0).then(|| mirrored(step).map(|step| &last[step % RUN][..]));
        prove(rule, lines, step, &mut here, &mut is_known, &mut runs);
        if was_known != is_known {
            for row in 0..rows {
                let at = row * stride + first;
                x[at..][..C].copy_from_slice(&here[row * C..][..C]);
                known[at..][..C].copy_from_slice(&is_known[row * C..][..C]);
            }
        }
        last[step % RUN] = here;
    }
}

/// Proves samples of a line by the `lines` behind it, the farthest first; none at the border.
#[inline(always)]
fn prove(
    rule: Rule<'_>,
    lines: Option<[&[f32]; RUN]>,
    step: usize,
    x: &mut [f32],
    known: &mut [u8],
    runs: &mut [u8],
) {
    let chunks = x.as_chunks_mut::<CHUNK>().0.iter_mut().zip(known.as_chunks_mut::<CHUNK>().0);
    for (at, ((x, known), runs)) in chunks.zip(runs.as_chunks_mut::<CHUNK>().0).enumerate() {
        let is_ready: [bool; CHUNK] =
            std::array::from_fn(|lane| known[lane] == 0 && usize::from(runs[lane]) >= RUN);
        if let Some(lines) = lines
            && is_ready.contains(&true)
        {
            let last = lines.map(|line| &line.as_chunks::<CHUNK>().0[at]);
            let (count, is_one) = counts(rule, x, last, &is_ready);
            for lane in 0..CHUNK {
                let is_proved = is_ready[lane] & is_one[lane];
                x[lane] += if is_proved { count[lane] } else { 0.0 };
                known[lane] |= u8::from(is_proved);
            }
        }
        // Up to the border, the mirrored samples are proved as well.
        let (mirror, most) = (2 * step.min(RUN) as u8, RUN as u8);
        for lane in 0..CHUNK {
            let more = if runs[lane] == mirror { 2 } else { 1 };
            runs[lane] = known[lane] * (runs[lane] + more).min(most);
        }
    }
}

/// Returns the least count that is possible for each sample of a chunk, and whether it is the only one.
#[inline(always)]
fn counts(
    rule: Rule<'_>,
    x: &[f32; CHUNK],
    last: [&[f32; CHUNK]; RUN],
    is_ready: &[bool; CHUNK],
) -> ([f32; CHUNK], [bool; CHUNK]) {
    let (mut least, mut greatest) = ([0.0_f32; CHUNK], [rule.most; CHUNK]);
    for stencil in &rule.family.stencils {
        let mut sums = *x;
        let weights: &[f32; RUN] = stencil.weights.first_chunk().expect(IS_RUN);
        for (weight, line) in weights.iter().zip(last) {
            (0..CHUNK).for_each(|lane| sums[lane] += weight * line[lane]);
        }
        let mut is_open = false;
        for lane in 0..CHUNK {
            least[lane] = least[lane].max((stencil.least - sums[lane]).ceil());
            greatest[lane] = greatest[lane].min((stencil.greatest - sums[lane]).floor());
            is_open |= is_ready[lane] & (least[lane] != greatest[lane]);
        }
        if !is_open {
            break;
        }
    }
    (least, std::array::from_fn(|lane| least[lane] == greatest[lane]))
}

/// Returns the count of a sample by its neighbours, if only one is possible.
fn one_count(rule: Rule<'_>, x: f32, neighbours: impl Iterator<Item = f32> + Clone) -> Option<f32> {
    let (mut least, mut greatest) = (0.0_f32, rule.most);
    for stencil in &rule.family.stencils {
        let sum = stencil.weights.iter().zip(neighbours.clone()).fold(x, |sum, (weight, x)| sum + weight * x);
        least = least.max((stencil.least - sum).ceil());
        greatest = greatest.min((stencil.greatest - sum).floor());
    }
    (least == greatest).then_some(least)
}

#[inline(always)]
fn are_possible(lines: [&[f32]; RUN], x: &[f32], stencil: &Stencil) -> bool {
    let weights: &[f32; RUN] = stencil.weights.first_chunk().expect(IS_RUN);
    let mut is_possible = true;
    for at in 0..x.len() {
        let sum = (0..RUN).fold(x[at], |sum, row| sum + weights[row] * lines[row][at]);
        is_possible &= (sum >= stencil.least) & (sum <= stencil.greatest);
    }
    is_possible
}
