//! A sweep that proves samples by those above and before them.
//!
//! A sample is proved by the [`corner`](super::stencil::corner) of those above it and before it in its row, or by the
//! [`run`](super::stencil::run) before it. Each row depends on the one above up to [`RADIUS`] columns ahead. So all
//! rows of a block are swept at once, each [`LAG`] columns behind the one above: at each step, the processor has a
//! sample of each row, none of which depends on another.

use super::plane::{Plane, View};
use super::stencil::{Family, RADIUS, ROWS, RUN};
use crate::simd::widest;

/// The columns that a row is behind the one above.
const LAG: isize = RADIUS + 1;

/// The samples of a step: those of 16 rows with three channels, or of 48 with one.
const LANES: usize = 48;

/// The place of the first row of a block in a step, behind those of the rows above it.
const FIRST: usize = 12;

/// The samples of a step with those of the rows above, and one more.
const BREADTH: usize = 64;

/// The steps that are remembered: as far back as the farthest sample of a corner.
const STEPS: usize = 16;

/// The last steps; step t is at t modulo [`STEPS`].
#[repr(align(64))]
struct Steps {
    /// The radiance as in [`Plane::x`].
    x: [[f32; BREADTH]; STEPS],
    /// The number of the last samples of a row, up to this step, that are proved; at most [`RUN`].
    runs: [[u8; BREADTH]; STEPS],
}

/// The samples of a step that are open: 1 where the count is not proved.
type Open = [u8; LANES];

/// How many samples a sweep has proved, and how many have no count that is possible.
#[derive(Clone, Copy, Default, PartialEq)]
pub(super) struct Found {
    pub proved: usize,
    pub impossible: usize,
}

impl Found {
    fn and(self, other: Self) -> Self {
        Self { proved: self.proved + other.proved, impossible: self.impossible + other.impossible }
    }
}

/// Some rows that are swept at once, in a view of the image.
#[derive(Clone, Copy)]
struct Block {
    view: View,
    first: isize,
    rows: isize,
    width: isize,
    /// The place of the first sample, and the ways to the next row and column.
    origin: isize,
    down: isize,
    right: isize,
}

/// Sweeps over the image in a view, by `families` whose samples lie above and before the one in their middle. Returns
/// how many of them it has proved, and how many have no count that is possible.
pub(super) fn sweep(plane: &mut Plane, view: View, families: &[&Family], most: f32) -> Found {
    let at_once = (LANES / plane.channels).cast_signed();
    let (height, width) = plane.size(view);
    let place = |row, column| plane.place(view, row, column).cast_signed();
    let (origin, right, down) = (place(0, 0), place(0, 1) - place(0, 0), place(1, 0) - place(0, 0));
    (0..height).step_by(LANES / plane.channels).fold(Found::default(), |sum, first| {
        let block = Block {
            view,
            first,
            rows: at_once.min(height - first),
            width,
            origin: origin + first * down,
            down,
            right,
        };
        let found = match plane.channels {
            1 => widest!(block.sweep::<1>(plane, families, most)),
            _ => widest!(block.sweep::<3>(plane, families, most)),
        };
        sum.and(found)
    })
}

/// Returns the place of a step in [`Steps`].
#[inline(always)]
fn slot(step: isize) -> usize {
    step.cast_unsigned() % STEPS
}

/// Returns the samples that lie so many rows below those of the block, or above them.
#[inline(always)]
fn lanes<T, const C: usize>(step: &[T; BREADTH], row: isize) -> &[T; LANES] {
    step[lane::<C>(row)..].first_chunk().expect("a step has place for the rows above a block")
}

impl Steps {
    /// Brings the runs up to a step.
    #[inline(always)]
    fn count(&mut self, step: isize) {
        let last = self.runs[slot(step - 1)];
        for (at, run) in self.runs[slot(step)].iter_mut().enumerate() {
            *run = if self.x[slot(step)][at] > 0.0 { (last[at] + 1).min(RUN as u8) } else { 0 };
        }
    }
}

/// Returns the place of a row of a block in a step.
#[inline(always)]
fn lane<const C: usize>(row: isize) -> usize {
    FIRST.wrapping_add_signed(row * C.cast_signed())
}

impl Block {
    #[inline(always)]
    fn sweep<const C: usize>(self, plane: &mut Plane, families: &[&Family], most: f32) -> Found {
        let mut found = Found::default();
        let mut steps = Steps { x: [[0.0; BREADTH]; STEPS], runs: [[0; BREADTH]; STEPS] };
        let begin = -RUN.cast_signed() - LAG * ROWS;
        for step in begin..self.width + RADIUS + LAG * (self.rows - 1) {
            let mut open = self.load::<C>(plane, step, &mut steps);
            if open != [0; LANES] {
                let before = found;
                for family in families {
                    if open == [0; LANES] {
                        break;
                    }
                    found = found.and(prove::<C>(&mut steps, step, family, &mut open, most));
                }
                if found != before {
                    self.store::<C>(plane, step, &steps.x[slot(step)]);
                }
            }
            steps.count(step);
        }
        found
    }

    /// Returns the place of a sample inside the image.
    #[inline(always)]
    fn place<const C: usize>(self, row: isize, column: isize) -> usize {
        (self.origin + row * self.down + column * self.right).cast_unsigned()
    }

    /// Reads a step, and returns which of its samples are open.
    #[inline(always)]
    fn load<const C: usize>(self, plane: &Plane, step: isize, steps: &mut Steps) -> Open {
        let x = &mut steps.x[slot(step)];
        let (first, last) = (step - LAG * (self.rows - 1), step + LAG * ROWS);
        let is_inner = first >= 0 && last < self.width && self.first >= ROWS;
        let mut is_inside = [u8::from(is_inner); LANES];
        if is_inner {
            for row in -ROWS..self.rows {
                let place = self.place::<C>(row, step - LAG * row);
                // The fourth one is overwritten by the next row.
                x[lane::<C>(row)..][..C + 1].copy_from_slice(&plane.x[place..][..C + 1]);
            }
            is_inside[self.rows.cast_unsigned() * C..].fill(0);
        } else {
            for row in -ROWS..self.rows {
                let column = step - LAG * row;
                let place = plane.place(self.view, self.first + row, column);
                x[lane::<C>(row)..][..C + 1].copy_from_slice(&plane.x[place..][..C + 1]);
                if row >= 0 {
                    let is_column = (0..self.width).contains(&column);
                    is_inside[row.cast_unsigned() * C..][..C].fill(u8::from(is_column));
                }
            }
        }
        for lane in 0..LANES {
            is_inside[lane] &= u8::from(x[FIRST + lane] < 0.0);
        }
        is_inside
    }

    /// Writes the samples of a step.
    #[inline(always)]
    fn store<const C: usize>(self, plane: &mut Plane, step: isize, x: &[f32; BREADTH]) {
        for row in 0..self.rows {
            let column = step - LAG * row;
            if (0..self.width).contains(&column) {
                let place = self.place::<C>(row, column);
                plane.x[place..][..C].copy_from_slice(&x[lane::<C>(row)..][..C]);
            }
        }
    }
}

/// Proves open samples of a step by a family.
#[inline(always)]
fn prove<const C: usize>(
    steps: &mut Steps,
    step: isize,
    family: &Family,
    open: &mut Open,
    most: f32,
) -> Found {
    let mut ready = *open;
    for line in &family.lines {
        let last = &steps.runs[slot(step + line.last() + LAG * line.row)];
        let runs: &[u8; LANES] = lanes::<_, C>(last, line.row);
        (0..LANES).for_each(|at| ready[at] &= u8::from(runs[at] >= line.count as u8));
    }
    if ready == [0; LANES] {
        return Found::default();
    }
    let counts = counts::<C>(steps, step, family, &ready, most);
    take(&mut steps.x[slot(step)], &ready, counts, open)
}

/// Returns the least and the greatest count that is possible for each sample of a step. Only those for the samples that
/// are `ready` mean something.
#[inline(always)]
fn counts<const C: usize>(
    steps: &Steps,
    step: isize,
    family: &Family,
    ready: &Open,
    most: f32,
) -> [[f32; LANES]; 2] {
    let mut code: [f32; LANES] = *lanes::<_, C>(&steps.x[slot(step)], 0);
    code.iter_mut().for_each(|code| *code = code.abs());
    let [mut least, mut greatest] = [[0.0_f32; LANES], [most; LANES]];
    for stencil in &family.stencils {
        let mut sums = code;
        for (&[row, column], weight) in family.places.iter().zip(&stencil.weights) {
            let x: &[f32; LANES] = lanes::<_, C>(&steps.x[slot(step + column + LAG * row)], row);
            (0..LANES).for_each(|at| sums[at] += weight * x[at]);
        }
        let mut is_open = 0;
        for at in 0..LANES {
            least[at] = least[at].max((stencil.least - sums[at]).ceil());
            greatest[at] = greatest[at].min((stencil.greatest - sums[at]).floor());
            is_open |= ready[at] & u8::from(least[at] < greatest[at]);
        }
        if is_open == 0 {
            break;
        }
    }
    [least, greatest]
}

/// Takes the counts of which only one is possible. A sample for which none is possible is left out.
#[inline(always)]
fn take(
    x: &mut [f32; BREADTH],
    ready: &Open,
    [least, greatest]: [[f32; LANES]; 2],
    open: &mut Open,
) -> Found {
    let (mut proved, mut impossible) = ([0_u8; LANES], [0_u8; LANES]);
    for at in 0..LANES {
        proved[at] = ready[at] & u8::from(least[at] == greatest[at]);
        impossible[at] = ready[at] & u8::from(least[at] > greatest[at]);
        open[at] &= !(proved[at] | impossible[at]);
    }
    for at in 0..LANES {
        let own = x[FIRST + at];
        let own = if impossible[at] != 0 { f32::NAN } else { own };
        x[FIRST + at] = if proved[at] != 0 { own.abs() + least[at] } else { own };
    }
    let count = |of: [u8; LANES]| of.iter().sum::<u8>().into();
    Found { proved: count(proved), impossible: count(impossible) }
}
