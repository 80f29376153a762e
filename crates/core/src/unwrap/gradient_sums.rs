//! Gradient sums: finds the differences between the green pixels of a mosaic by path sums over the gradient.
//!
//! The green pixels of a mosaic have neighbours along both diagonals. With `g = M_b(d y)`, `d x = g + n 2^b` is the gradient along one of
//! them, of which n is sought: -1, 0 or 1. The gradient changes little from pixel to pixel, and is small nearly everywhere. n has the least
//! sum over the paths L of semi-global matching (Hirschmueller 2008, *PAMI* 30) along both diagonals in both senses, in 256ths of the peak
//! ```text
//!     L_n(q) = |h_n(q)| / 51 + min_o (L_o(p) + |h_n(q) - h_o(p)|) - min_o L_o(p),   h_n = g + n 2^b
//! ```
//! A path along the direction of the gradient meets its second differences, and one across it mixed ones. Where one of them exceeds half
//! a peak, those of the other paths and of the pixels around decide.
//!
//! All paths go from row to row, so that the pixels of a row are the lanes of vectors. The two gradients share nothing, so that each can
//! have a thread.

use super::mosaic_image::MosaicImage;
use crate::mosaic::GREEN;
use crate::simd::widest;
use crate::workers::{Workers, WorkersError};

/// The pixels of a row that are worked on together.
const LANES: usize = 32;

/// The choices of n: -1, 0 and 1.
const CHOICES: usize = 3;

/// The peak of the gradient.
const PEAK: i16 = 256;

/// The value of a cost of 1/256 of the peak. The least L of a pixel is 0 at the pixel before, and differences are below 768, so that four
/// of them stay below 2^16.
const COST: u16 = 8;

/// The value of a margin of 1 in the margins of the result: 4/256 of the peak.
const MARGIN: u16 = 4 * COST;

type Lanes = [u16; LANES];

/// The green pixels of a mosaic: the one at index t of row i is in column `2 t + shift`.
#[derive(Default)]
pub(super) struct GreenCodes {
    /// The upper 8 bits of the codes, row after row, with one pixel more at both ends.
    codes: Vec<u8>,
    pub height: usize,
    /// The green pixels of a row. In a mosaic of odd width, every second row has one less, and repeats its last one.
    pub width: usize,
    /// The shift of the first row.
    first: usize,
}

impl GreenCodes {
    /// Takes the green pixels of an image, whose codes have so many bits.
    pub fn read(&mut self, image: &MosaicImage<'_>, bits: u8) {
        (self.height, self.width) = (image.height, image.width.div_ceil(2));
        self.first = usize::from(image.mosaic.channel(0, 0) != GREEN);
        self.codes.clear();
        for (row, codes) in image.codes.chunks_exact(image.width).enumerate() {
            let from = self.codes.len();
            self.codes.push(0);
            let green = codes.get(self.shift(row)..).unwrap_or_default().iter().step_by(2);
            let upper = |&code: &u16| if bits > 8 { code >> (bits - 8) } else { code << (8 - bits) } as u8;
            self.codes.extend(green.map(upper));
            // Beyond the border of a mosaic lies its mirror image, in which the next green pixel is this one.
            let last = self.codes[self.codes.len() - 1];
            self.codes.resize(from + self.width + 2, last);
            self.codes[from] = self.codes[from + 1];
        }
    }

    /// Returns all codes with those at both ends, and the shape of this image.
    pub fn padded(&self) -> (&[u8], (usize, usize, usize)) {
        (&self.codes, (self.height, self.width + 2, 1))
    }

    /// Returns the column of the first green pixel of a row, 0 or 1. It changes from row to row.
    pub fn shift(&self, row: usize) -> usize {
        (row + self.first) % 2
    }

    /// Returns how much greater the index of the neighbour in the next row is, plus one.
    pub fn ahead(&self, direction: usize, row: usize) -> usize {
        self.shift(row) + 1 - direction
    }

    /// Returns the indices of both ends of the first edge from a row to the next one: the first pixel has no neighbour to the left in rows
    /// that begin with it.
    pub fn ends_of_edges(&self, direction: usize, row: usize) -> (usize, usize) {
        let ahead = self.ahead(direction, row);
        (usize::from(ahead == 0), ahead.saturating_sub(1))
    }

    /// Returns the upper 8 bits of the code of a pixel.
    pub fn code(&self, at: usize) -> u8 {
        self.row(at / self.width)[1 + at % self.width]
    }

    /// Returns the codes of a row, and those of the neighbours in the next one.
    fn ends(&self, direction: usize, row: usize) -> (&[u8], &[u8]) {
        let ahead = self.ahead(direction, row);
        (&self.row(row)[1..][..self.width], &self.row(row + 1)[ahead..][..self.width])
    }

    /// Returns the codes of a row with one more at both ends.
    fn row(&self, row: usize) -> &[u8] {
        &self.codes[row * (self.width + 2)..][..self.width + 2]
    }
}

/// The choice with its buffers.
pub(super) struct GradientSums {
    workers: Workers,
    /// The gradients down to the right and down to the left.
    directions: [DirectionalSums; 2],
}

impl GradientSums {
    /// Runs on `threads` threads, of which it needs two.
    ///
    /// # Errors
    /// [`WorkersError`] when the threads are not available.
    pub fn new(threads: usize) -> Result<Self, WorkersError> {
        let directions = [0, 1].map(|direction| DirectionalSums { direction, ..DirectionalSums::default() });
        Ok(Self { workers: Workers::new(threads)?, directions })
    }

    /// Finds the steps between the counts of neighbours.
    pub fn find(&mut self, codes: &GreenCodes) {
        self.workers.each(&mut self.directions, |_, direction| direction.find(codes));
    }

    /// Halves the margins of the steps that are not those between `counts`, of which there is one for each pixel.
    pub fn doubt(&mut self, codes: &GreenCodes, counts: &[i32]) {
        for sums in &mut self.directions {
            let rows = counts.chunks_exact(codes.width);
            for (row, (here, next)) in rows.clone().zip(rows.skip(1)).enumerate() {
                let (first, second) = codes.ends_of_edges(sums.direction, row);
                let edges = row * sums.pitch + first..(row + 1) * sums.pitch;
                let edges = sums.steps[edges.clone()].iter().zip(&mut sums.margins[edges]);
                let differences = here[first..].iter().zip(&next[second..]).map(|(from, to)| to - from);
                differences
                    .zip(edges)
                    .filter(|(difference, (step, _))| *difference != i32::from(**step))
                    .for_each(|(_, (_, margin))| *margin /= 2);
            }
        }
    }

    /// Returns for each pixel of a row how much greater the count of its neighbour down to the right (direction 0) or to the left (1) is, and the
    /// margin of this result.
    pub fn row(&self, direction: usize, row: usize) -> (&[i8], &[u8]) {
        let sums = &self.directions[direction];
        let pixels = row * sums.pitch..(row + 1) * sums.pitch;
        (&sums.steps[pixels.clone()], &sums.margins[pixels])
    }
}

/// One of the two gradients, from each pixel to its neighbour in the next row.
#[derive(Default)]
struct DirectionalSums {
    direction: usize,
    pitch: usize,
    /// The gradient of each row, with one pixel more at both ends.
    gradient: Vec<i16>,
    /// The sums of the paths that go down.
    sums: Vec<[Lanes; CHOICES]>,
    /// L of the two paths at the last row, and at this one, with one pixel more at both ends.
    last: [Path; 2],
    here: [Path; 2],
    /// How much greater the count of the neighbour is, and the margin.
    steps: Vec<i8>,
    margins: Vec<u8>,
}

/// L of a row, for each choice.
type Path = [Vec<u16>; CHOICES];

impl DirectionalSums {
    fn find(&mut self, codes: &GreenCodes) {
        let (rows, blocks) = (codes.height - 1, codes.width.div_ceil(LANES));
        self.pitch = blocks * LANES;
        self.take_gradient(codes, rows);
        self.sums.resize(rows * blocks, [[0; LANES]; CHOICES]);
        self.steps.resize(rows * self.pitch, 0);
        self.margins.resize(rows * self.pitch, 0);
        for path in self.last.iter_mut().chain(&mut self.here).flatten() {
            path.clear();
            path.resize(self.pitch + 2, 0);
        }
        for row in 0..rows {
            let mut sums = std::mem::take(&mut self.sums);
            let to = &mut sums[row * blocks..][..blocks];
            widest!(self.follow(codes, row.saturating_sub(1), row, |block, both| to[block] = both));
            self.sums = sums;
        }
        // The other way, a path starts anew.
        self.last.iter_mut().flatten().for_each(|path| path.fill(0));
        for row in (0..rows).rev() {
            let (mut steps, mut margins) =
                (std::mem::take(&mut self.steps), std::mem::take(&mut self.margins));
            let sums = std::mem::take(&mut self.sums);
            let from = &sums[row * blocks..][..blocks];
            let pixels = row * self.pitch..(row + 1) * self.pitch;
            let (to, margin) = (steps[pixels.clone()].as_chunks_mut().0, margins[pixels].as_chunks_mut().0);
            widest!(self.follow(codes, (row + 1).min(rows - 1), row, |block, both| {
                settle(&from[block], &both, &mut to[block], &mut margin[block]);
            }));
            (self.steps, self.margins, self.sums) = (steps, margins, sums);
        }
        self.add_wraps(codes);
    }

    /// Writes the wrapped differences of neighbours.
    fn take_gradient(&mut self, codes: &GreenCodes, rows: usize) {
        let padded = self.pitch + 2;
        self.gradient.resize(rows * padded, 0);
        for (row, gradient) in self.gradient.chunks_exact_mut(padded).enumerate() {
            let (here, next) = codes.ends(self.direction, row);
            let inner = gradient[1..].iter_mut().zip(here.iter().zip(next));
            widest!(inner.for_each(|(gradient, (here, next))| {
                *gradient = next.wrapping_sub(*here).cast_signed().into();
            }));
            repeat_ends(gradient, codes.width);
        }
    }

    /// Follows both paths from row `before` to row `row`, and hands the sum of both L to `take`, block after block.
    #[inline(always)]
    fn follow(
        &mut self,
        codes: &GreenCodes,
        before: usize,
        row: usize,
        mut take: impl FnMut(usize, [Lanes; CHOICES]),
    ) {
        let (padded, shift) = (self.pitch + 2, codes.shift(row));
        let [from, to] = [before, row].map(|row| &self.gradient[row * padded..][..padded]);
        for block in 0..self.pitch / LANES {
            let mut both = [[0; LANES]; CHOICES];
            // The pixels of the row before on both sides.
            for (side, (last, here)) in self.last.iter().zip(&mut self.here).enumerate() {
                let at = block * LANES + shift + side;
                let [less, none, more] = last;
                let before = [*lanes(less, at), *lanes(none, at), *lanes(more, at)];
                let next = step(&before, lanes(from, at), lanes(to, block * LANES + 1));
                for ((both, next), here) in both.iter_mut().zip(next).zip(here) {
                    here[block * LANES + 1..][..LANES].copy_from_slice(&next);
                    both.iter_mut().zip(next).for_each(|(both, next)| *both += next);
                }
            }
            take(block, both);
        }
        std::mem::swap(&mut self.last, &mut self.here);
        self.last.iter_mut().flatten().for_each(|path| repeat_ends(path, codes.width));
    }

    /// Adds to the chosen n what the codes of the neighbours wrap by themselves.
    fn add_wraps(&mut self, codes: &GreenCodes) {
        let gradients = self.gradient.chunks_exact(self.pitch + 2);
        for (row, (steps, gradient)) in self.steps.chunks_exact_mut(self.pitch).zip(gradients).enumerate() {
            let (here, next) = codes.ends(self.direction, row);
            let samples = gradient[1..].iter().zip(here.iter().zip(next));
            widest!(steps.iter_mut().zip(samples).for_each(|(step, (gradient, (here, next)))| {
                *step += ((gradient - (i16::from(*next) - i16::from(*here))) / PEAK) as i8;
            }));
        }
    }
}

/// Copies the first and the last one of `count` values to both ends of a row.
fn repeat_ends<T: Copy>(row: &mut [T], count: usize) {
    row[0] = row[1];
    row[count + 1] = row[count];
}

#[inline(always)]
fn lanes<T>(row: &[T], at: usize) -> &[T; LANES] {
    row[at..].first_chunk().expect("a block and the ends fit into a row")
}

/// Takes one step of a path in each lane, from L of the pixels before and the gradient there.
#[inline(always)]
fn step(before: &[Lanes; CHOICES], from: &[i16; LANES], to: &[i16; LANES]) -> [Lanes; CHOICES] {
    let [before_less, before_none, before_more] = before;
    let mut next = [[0; LANES]; CHOICES];
    for lane in 0..LANES {
        let change = to[lane] - from[lane];
        let edge = |ahead: i16| (change + ahead * PEAK).unsigned_abs() * COST;
        let (two_down, down, same, up, two_up) = (edge(-2), edge(-1), edge(0), edge(1), edge(2));
        let (a, b, c) = (before_less[lane], before_none[lane], before_more[lane]);
        let least = a.min(b).min(c);
        let own = |ahead: i16| ((to[lane] + ahead * PEAK).unsigned_abs() * 5) >> 5;
        next[0][lane] = own(-1) + (a + same).min(b + down).min(c + two_down) - least;
        next[1][lane] = own(0) + (a + up).min(b + same).min(c + down) - least;
        next[2][lane] = own(1) + (a + two_up).min(b + up).min(c + same) - least;
    }
    next
}

/// Writes the choices with the least sums, as n, and their margins.
#[inline(always)]
fn settle(
    down: &[Lanes; CHOICES],
    up: &[Lanes; CHOICES],
    chosen: &mut [i8; LANES],
    margins: &mut [u8; LANES],
) {
    for lane in 0..LANES {
        let (less, none, more) =
            (down[0][lane] + up[0][lane], down[1][lane] + up[1][lane], down[2][lane] + up[2][lane]);
        let (other, least) = (less.max(more), less.min(more));
        let ahead = if less < more { -1 } else { 1 };
        chosen[lane] = if none <= least { 0 } else { ahead };
        let best = least.min(none);
        let second = if none <= least { least } else { none.min(other) };
        margins[lane] = ((second - best) / MARGIN).min(255) as u8;
    }
}
