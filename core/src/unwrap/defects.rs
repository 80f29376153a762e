//! Finds hot, dead and stuck samples in y, which contradict all their neighbours, and leaves them out of the unwrapping.
//!
//! A sample that is off by d adds d to the mixed differences of its four 2 x 2 loops, if each is counted from the sample:
//! ```text
//!     m = y(i, j) - y(i, j') - y(i', j) + y(i', j')   modulo 2^b,   i' = i - 1, i + 1,   j' = j - 1, j + 1
//! ```
//! Behind a lens, the m of a sound sample lie near 0 or on both sides of it, since m changes its sign from loop to loop where y is
//! smooth. Those of a defect are all far from 0: all in 1/8 to 3/4 of the peak, or all in 1/4 to 7/8. The intervals contain half a peak,
//! which is as far from 0 on either side. Where m lie on both sides of it, a sound sample at a steep corner looks the same. But there
//! the loops around are steep, too, and a defect stands out from them.
//!
//! A defect is replaced by the value that its loops expect, y is unwrapped, and then the defect gets the count that brings it nearest
//! to this value. So it takes part in no vote, tree or quality metric.

use super::wrapped::Word;
use super::{Integers, Range, Recovered};
use crate::frame::{Frame, Samples};
use crate::simd::widest;

/// The largest share of the samples that are taken for defects. The count of every second defect differs from that of its neighbours,
/// so that with this share at most 0.05 % of the counts are wrong. An image with more is sharp, or noisy.
const MOST: f64 = 1e-3;

/// The least distance of each m of a defect from 0 on the side of its deviation, and on the other side, in eighths of the peak.
const NEAR: u16 = 1;
const FAR: u16 = 2;

/// The least m of a defect whose m lie on both sides, over the greatest mixed difference around it, in quarters. At the corner of an edge
/// behind a lens of 1.4 px it is at most 6.6 quarters, `exp(1 / sigma^2)`.
const STANDS_OUT: i32 = 7;

/// As many samples are looked at for each one that may be a defect.
const CANDIDATES: usize = 4;

/// The defects of an image, with buffers.
#[derive(Default)]
pub(super) struct Defects {
    /// Their indices in the interleaved samples, in ascending order.
    found: Vec<usize>,
    /// The samples that look like defects by themselves.
    candidates: Vec<usize>,
    /// The image without them.
    sound: Option<Frame>,
    bytes: Search<u8>,
    words: Search<u16>,
}

/// The samples around each sample: those of the same colour, `step` rows and `step` columns away.
#[derive(Clone, Copy)]
struct Surroundings {
    height: usize,
    width: usize,
    channels: usize,
    step: usize,
}

impl Defects {
    /// Returns `y` without its defects, and their share of the samples; `None` if it has none, or too many to be defects. The
    /// samples of a colour mosaic are compared with those of the same colour.
    pub fn remove(&mut self, y: &Frame, codes: Integers<'_>, range: Range) -> Option<(&Frame, f32)> {
        let (height, width, channels) = y.dim();
        let around = Surroundings { height, width, channels, step: if y.mosaic().is_some() { 2 } else { 1 } };
        self.found.clear();
        // A smaller image has no neighbours on both sides, and the mirror image of one side says nothing new.
        if height.min(width) < 2 * around.step + 1 {
            return None;
        }
        let most = (MOST * (height * width * channels) as f64) as usize;
        // Reserved at once, so that no later frame of this size allocates.
        self.candidates.clear();
        self.candidates.reserve(CANDIDATES * most);
        self.found.reserve(most + 1);
        let candidates = &mut self.candidates;
        let few = match codes {
            Integers::U8(codes) => self.bytes.find(codes, around, range, CANDIDATES * most, candidates),
            Integers::U16(codes) => self.words.find(codes, around, range, CANDIDATES * most, candidates),
        };
        if few {
            let stand_out = self.candidates.iter().filter(|at| around.stands_out(codes, **at, range));
            self.found.extend(stand_out.take(most + 1));
        }
        if self.found.is_empty() || self.found.len() > most {
            self.found.clear();
            return None;
        }
        let share = self.found.len() as f32 / (height * width * channels) as f32;
        Some((self.replace(y, around, range), share))
    }

    /// Gives the samples that were removed from `y` the counts that bring them nearest to the values in their place in `out`.
    pub fn restore(&self, codes: Integers<'_>, range: Range, out: &mut Recovered) {
        let (peak, most) = (range.peak(), f32::from(range.max_wraps()));
        let (x, k) = out.buffers();
        for &at in &self.found {
            let y = f32::from(codes.at(at));
            let count = ((x[at] - y) / peak).round().clamp(0.0, most);
            (x[at], k[at]) = (y + count * peak, count as u8);
        }
    }

    /// Copies `y`, with the value that the neighbours expect at each defect.
    fn replace(&mut self, y: &Frame, around: Surroundings, range: Range) -> &Frame {
        let sound = self.sound.get_or_insert_with(|| y.clone());
        sound.copy_from(y);
        match sound.samples_mut() {
            Samples::U8(samples) => {
                let samples = samples.as_slice_mut().expect("a frame is in standard layout");
                around.replace(samples, &self.found, range, |code| code as u8);
            }
            Samples::U16(samples) => {
                let samples = samples.as_slice_mut().expect("a frame is in standard layout");
                around.replace(samples, &self.found, range, |code| code);
            }
            Samples::F32(_) => unreachable!("the codes of a modulo image are integers"),
        }
        sound
    }
}

impl Surroundings {
    /// Returns the indices of the other three samples of each loop of a sample: beside it, above or below it, and across.
    fn loops(self, at: usize) -> [[usize; 3]; 4] {
        let stride = self.width * self.channels;
        let (row, column, channel) =
            (at / stride, at % stride / self.channels, at % self.channels);
        let rows = both_sides(row, self.height, self.step);
        let columns = both_sides(column, self.width, self.step);
        let index = |row: usize, column: usize| row * stride + column * self.channels + channel;
        [(0, 0), (0, 1), (1, 0), (1, 1)]
            .map(|(i, j)| [index(row, columns[j]), index(rows[i], column), index(rows[i], columns[j])])
    }

    /// Returns whether a candidate contradicts its neighbours on one side of 0, or more than the loops around it contradict
    /// each other.
    fn stands_out(self, codes: Integers<'_>, at: usize, range: Range) -> bool {
        let peak = 1 << range.bits();
        let code = |at: usize| i32::from(codes.at(at));
        let wrapped = |difference: i32| (difference + peak / 2).rem_euclid(peak) - peak / 2;
        let m = self.loops(at).map(|[beside, above, across]| {
            wrapped(code(at) - code(beside) - code(above) + code(across))
        });
        if m.iter().all(|&m| m > 0) || m.iter().all(|&m| m < 0) {
            return true;
        }
        let least = m.iter().map(|m| m.abs()).min().expect("there are four loops");
        let mixed = |[a, b, c, d]: [usize; 4]| wrapped(code(a) - code(b) - code(c) + code(d)).abs();
        let steepest = self.loops_around(at).map(mixed).max().expect("there are loops around");
        4 * least > STANDS_OUT * steepest
    }

    /// Returns the corners of the loops around those of a sample.
    fn loops_around(self, at: usize) -> impl Iterator<Item = [usize; 4]> {
        let Self { height, width, channels, step } = self;
        let stride = width * channels;
        let (row, column) = (at / stride, at % stride / channels);
        let inside = move |at: usize, steps: usize, length: usize| {
            (at + steps * step).checked_sub(2 * step).filter(|at| at + step < length)
        };
        let of_sample = |i: usize, j: usize| (1..3).contains(&i) && (1..3).contains(&j);
        let places = (0..4).flat_map(|i| (0..4).map(move |j| (i, j))).filter(move |&(i, j)| !of_sample(i, j));
        places.filter_map(move |(i, j)| {
            let (row, column) = (inside(row, i, height)?, inside(column, j, width)?);
            let first = row * stride + column * channels + at % channels;
            let (right, down) = (step * channels, step * stride);
            Some([first, first + right, first + down, first + right + down])
        })
    }

    /// Replaces each sample of the indices `found`, which ascend.
    fn replace<T>(self, samples: &mut [T], found: &[usize], range: Range, sample: impl Fn(u16) -> T)
    where
        T: Copy + Into<u16>,
    {
        for &at in found {
            // A loop with another defect says nothing, unless that defect was replaced already.
            let is_sound = |indices: &&[usize; 3]| {
                indices.iter().all(|other| *other < at || found.binary_search(other).is_err())
            };
            let value = expected(samples, self.loops(at).iter().filter(is_sound), range);
            // A sample that has only defects around it stays as it is.
            if let Some(value) = value {
                samples[at] = sample(value);
            }
        }
    }
}

/// Returns the sample that `loops` expect: the value for which the mixed difference is 0, on average over those in the middle.
fn expected<'a, T: Copy + Into<u16>>(
    samples: &[T],
    loops: impl Iterator<Item = &'a [usize; 3]>,
    range: Range,
) -> Option<u16> {
    let peak = 1 << range.bits();
    let code = |at: usize| i32::from(samples[at].into());
    let mut values = loops.map(|&[beside, above, across]| code(beside) + code(above) - code(across));
    let first = values.next()?;
    let (mut offsets, mut count) = ([0; 4], 1);
    for value in values {
        // Only the differences between values have a mean; the values themselves are known up to multiples of the peak.
        offsets[count] = (value - first + peak / 2).rem_euclid(peak) - peak / 2;
        count += 1;
    }
    let offsets = &mut offsets[..count];
    offsets.sort_unstable();
    // The mean of the two in the middle: a defect that was not found spoils one loop in four.
    let twice = offsets[(count - 1) / 2] + offsets[count / 2];
    Some((first + twice.div_euclid(2)).rem_euclid(peak) as u16)
}

/// Returns the places `step` before and after `at`, of which those beyond the border are mirrored.
fn both_sides(at: usize, length: usize, step: usize) -> [usize; 2] {
    let before = at.checked_sub(step).unwrap_or(at + step);
    let after = if at + step < length { at + step } else { at - step };
    [before, after]
}

/// The buffers for a search in words of one width.
#[derive(Default)]
struct Search<W> {
    /// The codes of the last rows, with a mirror image of `step` pixels at both ends: row i lies at i modulo 5.
    rows: [Vec<W>; 5],
    /// Whether each sample of a row is a defect, 1 or 0.
    flags: Vec<W>,
}

impl<W: Word> Search<W> {
    /// Writes the indices of the defects among `samples` to `found`. Returns whether there are at most `most`; the search ends when
    /// there are more.
    fn find<S>(
        &mut self,
        samples: &[S],
        around: Surroundings,
        range: Range,
        most: usize,
        found: &mut Vec<usize>,
    ) -> bool
    where
        S: Copy + Into<u16>,
    {
        let Surroundings { height, width, channels, step } = around;
        let (stride, margin) = (width * channels, step * channels);
        self.flags.clear();
        self.flags.resize(stride, W::default());
        let mut read = 0;
        for row in 0..height {
            while read < height.min(row + step + 1) {
                let codes = &mut self.rows[read % 5];
                widest!(read_row(&samples[read * stride..][..stride], around, range.bits(), codes));
                read += 1;
            }
            let [above, below] = both_sides(row, height, step).map(|row| &self.rows[row % 5][..]);
            let rows = [above, &self.rows[row % 5], below];
            let flags = &mut self.flags;
            // Most rows have no defect, which one pass in vectors tells.
            if !widest!(flag_row(rows, margin, flags)) {
                continue;
            }
            let defects = flags.iter().enumerate().filter(|(_, flag)| **flag != W::default());
            for (sample, _) in defects {
                if found.len() == most {
                    return false;
                }
                found.push(row * stride + sample);
            }
        }
        true
    }
}

/// Writes a row of samples as codes, with the samples beyond its ends that [`both_sides`] takes.
#[inline(always)]
fn read_row<S: Copy + Into<u16>, W: Word>(row: &[S], around: Surroundings, bits: u8, codes: &mut Vec<W>) {
    let margin = around.step * around.channels;
    let code = |&sample: &S| W::low(sample.into() << (W::BITS - bits));
    codes.clear();
    codes.extend(row[margin..2 * margin].iter().map(code));
    codes.extend(row.iter().map(code));
    codes.extend(row[row.len() - 2 * margin..][..margin].iter().map(code));
}

/// Writes to `flags` which samples of the row in the middle are defects; returns whether one is. The rows have `margin` samples more
/// at both ends.
#[inline(always)]
fn flag_row<W: Word>(rows: [&[W]; 3], margin: usize, flags: &mut [W]) -> bool {
    let length = flags.len();
    let (near, far) = (W::low(NEAR << (W::BITS - 3)), W::low(FAR << (W::BITS - 3)));
    let [to_near, to_far] = [near, far].map(|limit| W::default().minus(limit));
    let [above, here, below] = rows;
    let (a, b, c) = (&above[..length], &above[margin..][..length], &above[2 * margin..][..length]);
    let (d, e, f) = (&here[..length], &here[margin..][..length], &here[2 * margin..][..length]);
    let (g, h, i) = (&below[..length], &below[margin..][..length], &below[2 * margin..][..length]);
    let mut any = W::default();
    for l in 0..length {
        let (up, down) = (e[l].minus(b[l]), e[l].minus(h[l]));
        let m = [
            up.minus(d[l].minus(a[l])),
            up.minus(f[l].minus(c[l])),
            down.minus(d[l].minus(g[l])),
            down.minus(f[l].minus(i[l])),
        ];
        let (least, most) = (m[0].min(m[1]).min(m[2].min(m[3])), m[0].max(m[1]).max(m[2].max(m[3])));
        let is_defect = ((least >= near) & (most <= to_far)) | ((least >= far) & (most <= to_near));
        flags[l] = W::one_if(is_defect);
        any = any.max(flags[l]);
    }
    any != W::default()
}
