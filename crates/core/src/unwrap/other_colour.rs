//! Unwraps red or blue of a mosaic as its difference from the green around it.
//!
//! The difference changes little from one red pixel to the next, even where the scene does, so that `auto` can unwrap it at twice the
//! distance.

use ndarray::Array3;

use super::mosaic_image::{MosaicImage, frame};
use super::{Auto, Options, Range, Recovered, Report, Scene, Trust, Unwrap, UnwrapError, congruence};
use crate::frame::in_order;
use crate::mosaic::mirrored;
use crate::simd::widest;

/// The measures that speak against a result.
#[derive(Clone, Copy, Debug)]
pub(super) struct OtherDoubts {
    /// The share of the pixels whose counts were out of range.
    pub outside: f64,
    /// The second differences of the difference from green above one peak, per pixel.
    pub jumps: f64,
    /// The trust of `auto` in this difference, and whether it has left something out.
    pub trust: Trust,
    pub is_over_budget: bool,
}

/// The method with its buffers.
pub(super) struct OtherColour {
    auto: Auto,
    difference: Recovered,
    counts: Vec<i32>,
    levels: Vec<usize>,
}

impl OtherColour {
    /// Makes the method.
    ///
    /// # Errors
    /// The errors of [`Auto::new`].
    pub fn new(options: &Options) -> Result<Self, UnwrapError> {
        let (auto, difference) = (Auto::of_differences(options)?, Recovered::default());
        Ok(Self { auto, difference, counts: Vec::new(), levels: Vec::new() })
    }

    /// Finds the counts at the pixels of one place in the 2 x 2 pixels, up to a constant, beside green in `x`, an image of the size of
    /// `image`, with so much `work` in ms.
    ///
    /// # Errors
    /// None: the codes are those of the range.
    pub fn find(
        &mut self,
        image: &MosaicImage<'_>,
        x: &[f32],
        (first, column): (usize, usize),
        range: Range,
        work: f64,
    ) -> Result<(), UnwrapError> {
        let MosaicImage { height, width, .. } = *image;
        let dim = ((height - first).div_ceil(2), (width - column).div_ceil(2), 1);
        let mut wrapped = vec![0; dim.0 * dim.1];
        self.counts.resize(wrapped.len(), 0);
        let lines = wrapped.chunks_exact_mut(dim.1).zip(self.counts.chunks_exact_mut(dim.1));
        for ((wrapped, counts), row) in lines.zip((first..).step_by(2)) {
            let line = |row: usize| &x[row * width..][..width];
            let [above, below] = [-1, 1].map(|down| line(mirrored(row.cast_signed() + down, height)));
            find_green([above, line(row), below], column, range.peak() / 16.0, counts);
            let codes = &image.codes[row * width..][column..width];
            widest!(take_from(codes, counts, wrapped, range.bits()));
        }
        let wrapped = Array3::from_shape_vec(dim, wrapped).expect("one difference for each pixel");
        let scene = Scene { work, radiance: false, ..range.of_differences().into() };
        self.auto.unwrap(&frame(wrapped, range), &scene, &mut self.difference)?;
        // A difference is known up to a multiple of the peak, and so are these counts.
        let known = in_order(self.difference.k.view());
        widest!(self.counts.iter_mut().zip(known).for_each(|(count, &k)| *count += i32::from(k)));
        Ok(())
    }

    /// Writes the counts that were found to `out`; returns what speaks against them.
    pub fn write(
        &mut self,
        image: &MosaicImage<'_>,
        (first, column): (usize, usize),
        range: Range,
        out: &mut Recovered,
    ) -> OtherDoubts {
        let zero = congruence::base_level(&self.counts, range, congruence::OUTLIERS, &mut self.levels);
        let mut outside = 0;
        let rows = self.counts.chunks_exact((image.width - column).div_ceil(2));
        for (counts, row) in rows.zip((first..).step_by(2)) {
            outside += image.write_row((row, column), (counts, zero), range, out);
        }
        let Report { quality, trust, is_over_budget, .. } = self.difference.report;
        let jumps = quality.map_or(0.0, |quality| quality.jumps).into();
        let outside = outside as f64 / self.counts.len() as f64;
        OtherDoubts { outside, jumps, trust, is_over_budget }
    }
}

/// Writes green at every second pixel of the middle one of the rows, from `column` on.
fn find_green([above, here, below]: [&[f32]; 3], column: usize, soft: f32, green: &mut [i32]) {
    let at_end = |column: usize| {
        let [left, right] = [-1, 1].map(|right| here[mirrored(column.cast_signed() + right, here.len())]);
        green_between([left, right, above[column], below[column]], soft)
    };
    let last = green.len() - 1;
    green[0] = at_end(column);
    green[last] = at_end(column + 2 * last);
    if let Some(inner) = green.get_mut(1..last) {
        // Pairs that begin with the pixel that is read, since steps of two would be read one by one.
        let beside = here[column + 1..].as_chunks::<2>().0;
        let [above, below] = [above, below].map(|row| row[column + 2..].as_chunks::<2>().0);
        let neighbours = beside.iter().zip(&beside[1..]).zip(above.iter().zip(below));
        widest!(for (green, ((left, right), (above, below))) in inner.iter_mut().zip(neighbours) {
            *green = green_between([left[0], right[0], above[0], below[0]], soft);
        });
    }
}

/// Writes the wrapped differences of every second code of a row from green. Whole numbers give each count without rounding: `green` becomes the
/// count of the code at which its difference is between 0 and the peak.
#[inline(always)]
fn take_from(codes: &[u16], green: &mut [i32], wrapped: &mut [u16], bits: u8) {
    let mask = (1 << bits) - 1;
    let differ = |code: u16, green: i32| {
        let ahead = green - i32::from(code);
        ((-ahead & mask) as u16, (ahead + mask) >> bits)
    };
    let (pairs, last_code) = codes.as_chunks::<2>();
    for ((green, wrapped), code) in green.iter_mut().zip(&mut *wrapped).zip(pairs) {
        (*wrapped, *green) = differ(code[0], *green);
    }
    if let ([code], [.., green], [.., wrapped]) = (last_code, green, wrapped) {
        (*wrapped, *green) = differ(*code, *green);
    }
}

/// Returns green, rounded, at a pixel of another colour from its neighbours to the left and right, above and below: their mean, with
/// more weight on the two opposite ones that agree.
#[inline(always)]
fn green_between([left, right, above, below]: [f32; 4], soft: f32) -> i32 {
    let weight = |a: f32, b: f32| {
        let difference = (a - b).abs() + soft;
        1.0 / (difference * difference)
    };
    let (along, across) = (weight(left, right), weight(above, below));
    let mean = (along * (left + right) + across * (above + below)) / (2.0 * (along + across));
    (mean + 0.5) as i32
}
