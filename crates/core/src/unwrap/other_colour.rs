//! Unwraps red or blue of a mosaic as its difference from the green around it.
//!
//! The difference changes little from one red pixel to the next, even where the scene does, so that `auto` can unwrap it at twice the
//! distance.

use ndarray::Array3;

use super::mosaic_image::{MosaicImage, frame};
use super::{Auto, Options, Range, Recovered, Report, Trust, Unwrap, UnwrapError, congruence};
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
    /// The codes of the pixels of the colour, and green there, rounded.
    codes: Vec<i32>,
    green: Vec<i32>,
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
        let [codes, green, counts] = [const { Vec::new() }; 3];
        Ok(Self { auto, codes, green, difference, counts, levels: Vec::new() })
    }

    /// Limits the work on each of the next images, in ms.
    pub fn limit_work(&mut self, ms: f64) {
        self.auto.limit_work(ms);
    }

    /// Finds the counts at the pixels of one place in the 2 x 2 pixels, up to a constant, beside green in `x`, an image of the size of
    /// `image`.
    ///
    /// # Errors
    /// None: the codes are those of the range.
    pub fn find(
        &mut self,
        image: &MosaicImage,
        x: &[f32],
        (first, column): (usize, usize),
        range: Range,
    ) -> Result<(), UnwrapError> {
        let MosaicImage { height, width, .. } = *image;
        let (mask, soft) = ((1 << range.bits()) - 1, range.peak() / 16.0);
        self.codes.clear();
        self.green.clear();
        for row in (first..height).step_by(2) {
            let (pairs, last) = image.codes[row * width..][column..width].as_chunks::<2>();
            self.codes.extend(pairs.iter().map(|&[code, _]| i32::from(code)));
            self.codes.extend(last.iter().map(|&code| i32::from(code)));
            let line = |row: usize| &x[row * width..][..width];
            let [above, below] = [-1, 1].map(|down| line(mirrored(row.cast_signed() + down, height)));
            self.add_green(above, line(row), below, column, soft);
        }
        // Whole numbers from here on, so that each count follows without rounding.
        let wrapped = self.codes.iter().zip(&self.green).map(|(code, green)| ((code - green) & mask) as u16);
        let dim = ((height - first).div_ceil(2), (width - column).div_ceil(2), 1);
        let wrapped = Array3::from_shape_vec(dim, wrapped.collect()).expect("one difference for each pixel");
        self.auto.unwrap(&frame(wrapped, range), range.of_differences(), &mut self.difference)?;
        // A difference is known up to a multiple of the peak, and so are these counts.
        let known = in_order(self.difference.x.view()).iter().zip(&self.green).zip(&self.codes);
        self.counts.clear();
        self.counts.extend(known.map(|((&x, green), code)| (x as i32 + green - code) >> range.bits()));
        Ok(())
    }

    /// Adds green at every second pixel of a row from `column` on.
    fn add_green(&mut self, above: &[f32], here: &[f32], below: &[f32], column: usize, soft: f32) {
        let (from, width) = (self.green.len(), here.len());
        self.green.resize(from + (width - column).div_ceil(2), 0);
        let green = &mut self.green[from..];
        let at_end = |column: usize| {
            let [left, right] = [-1, 1].map(|right| here[mirrored(column.cast_signed() + right, width)]);
            green_between([left, right, above[column], below[column]], soft)
        };
        let last = green.len() - 1;
        green[0] = at_end(column);
        green[last] = at_end(column + 2 * last);
        if let Some(inner) = green.get_mut(1..last) {
            widest!(for (at, green) in inner.iter_mut().enumerate() {
                let column = column + 2 * at + 2;
                *green =
                    green_between([here[column - 1], here[column + 1], above[column], below[column]], soft);
            });
        }
    }

    /// Writes the counts that were found to `out`; returns what speaks against them.
    pub fn write(
        &mut self,
        image: &MosaicImage,
        (first, column): (usize, usize),
        range: Range,
        out: &mut Recovered,
    ) -> OtherDoubts {
        let zero = congruence::base_level(&self.counts, range, congruence::OUTLIERS, &mut self.levels);
        let mut outside = 0;
        let rows = self.counts.chunks_exact((image.width - column).div_ceil(2));
        for (counts, row) in rows.zip((first..).step_by(2)) {
            let counts = counts.iter().map(|count| count.saturating_sub(zero));
            outside += image.write_row((row, column), counts, range, out);
        }
        let Report { quality, trust, is_over_budget, .. } = self.difference.report;
        let jumps = quality.map_or(0.0, |quality| quality.jumps).into();
        let outside = outside as f64 / self.counts.len() as f64;
        OtherDoubts { outside, jumps, trust, is_over_budget }
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
