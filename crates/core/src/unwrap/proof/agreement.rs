//! Whether samples agree with those around them: [`contradictions`], and the [`counts`] that all sides allow.

use super::plane::{Plane, View};
use super::stencil::{Family, Line, Stencil};
use crate::simd::widest;

/// The pixels to each side of a sample that must agree with it.
const RADIUS: usize = 2;

/// The samples that are checked at once.
pub(super) const CHUNK: usize = 64;

/// Returns the samples around one on all sides.
pub(super) fn hole() -> Vec<Line> {
    let radius = RADIUS.cast_signed();
    let line = |row: isize| match row {
        0 => vec![Line { row, first: -radius, count: RADIUS }, Line { row, first: 1, count: RADIUS }],
        _ => vec![Line { row, first: -radius, count: 2 * RADIUS + 1 }],
    };
    (-radius..=radius).flat_map(line).collect()
}

/// Returns the samples of the same channel at most so many rows and columns away from some.
pub(super) fn around(plane: &Plane, samples: &[usize], away: isize) -> Vec<usize> {
    let (height, width) = plane.size(View::PLAIN);
    let of_one = |&at: &usize| {
        let ([row, column], channel) = plane.pixel(at);
        let rows = (row - away).max(0)..(row + away + 1).min(height);
        let columns = (column - away).max(0)..(column + away + 1).min(width);
        rows.flat_map(move |row| {
            columns.clone().map(move |column| plane.place(View::PLAIN, row, column) + channel)
        })
    };
    samples.iter().flat_map(of_one).collect()
}

/// Returns the samples whose counts are excluded by those at `places` around them, in ascending order. Near the border
/// on the left and on the right, nothing is looked at; the lines have at least [`CHUNK`] samples between.
pub(super) fn contradictions(plane: &Plane, places: &[[isize; 2]], stencil: &Stencil) -> Vec<usize> {
    let (line, channels) = (plane.width * plane.channels, plane.channels.cast_signed());
    let reach = |sign: isize| {
        places.iter().map(|[_, column]| sign * column).max().unwrap_or(0).max(0).cast_unsigned()
    };
    let (first, last) = (reach(-1) * plane.channels, line - reach(1) * plane.channels);
    let mut found = Vec::new();
    let mut around = vec![0; places.len()];
    for row in 0..plane.height {
        for (start, [down, right]) in around.iter_mut().zip(places) {
            *start = plane.place(View::PLAIN, row.cast_signed() + down, 0).cast_signed() + right * channels;
        }
        for start in (first..last).step_by(CHUNK) {
            // The last chunk begins so early that it fits.
            let start = start.min(last - CHUNK);
            let own = row * line + start;
            let excluded = widest!(excluded(&plane.x, own, start.cast_signed(), &around, stencil));
            let is_known = |at: usize| {
                around
                    .iter()
                    .all(|&place| plane.is_known((place + (start + at).cast_signed()).cast_unsigned()))
            };
            let wrong =
                (0..CHUNK).filter(|&at| excluded >> at & 1 == 1 && plane.is_known(own + at) && is_known(at));
            found.extend(wrong.map(|at| own + at));
        }
    }
    found.dedup();
    found
}

/// Returns which of the samples from `own` on are not what those at `around`, from `start` on, allow, as bits.
#[inline(always)]
fn excluded(x: &[f32], own: usize, start: isize, around: &[isize], stencil: &Stencil) -> u64 {
    let part = |at: usize| -> &[f32; CHUNK] { x[at..].first_chunk().expect("a chunk lies in the image") };
    let mut sums = *part(own);
    for (place, weight) in around.iter().zip(&stencil.weights) {
        let x = part((place + start).cast_unsigned());
        (0..CHUNK).for_each(|at| sums[at] += weight * x[at]);
    }
    let mut any = 0_u8;
    for sum in &sums {
        any |= u8::from(*sum < stencil.least) | u8::from(*sum > stencil.greatest);
    }
    if any == 0 {
        return 0;
    }
    let is_out = |sum: f32| u64::from(sum < stencil.least || sum > stencil.greatest);
    sums.iter().enumerate().fold(0, |bits, (at, &sum)| bits | is_out(sum) << at)
}

/// Returns the least and the greatest count that the proved samples around one allow it, in all views.
pub(super) fn counts(plane: &Plane, families: &[&Family], at: usize, most: f32) -> (f32, f32) {
    let (mut least, mut greatest) = (0.0_f32, most);
    let code = plane.x[at].abs().fract();
    for view in View::all() {
        let ([row, column], channel) = plane.pixel(at);
        let (height, width) = plane.size(View::PLAIN);
        let row = if view.is_lower { height - 1 - row } else { row };
        let column = if view.is_right { width - 1 - column } else { column };
        let [row, column] = if view.is_turned { [column, row] } else { [row, column] };
        for family in families {
            let x = |&[i, j]: &[isize; 2]| plane.x[plane.place(view, row + i, column + j) + channel];
            if family.places.iter().rev().all(|place| x(place) > 0.0) {
                for stencil in &family.stencils {
                    let weighted =
                        family.places.iter().zip(&stencil.weights).map(|(place, weight)| weight * x(place));
                    let sum = weighted.fold(code, |sum, x| sum + x);
                    least = least.max((stencil.least - sum).ceil());
                    greatest = greatest.min((stencil.greatest - sum).floor());
                }
            }
        }
    }
    (least, greatest)
}
