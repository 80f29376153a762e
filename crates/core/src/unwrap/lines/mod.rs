//! Lines: unwraps the gradient before the image, along lines, in integers.
//!
//! Itoh's method needs first differences below half a peak; here only *mixed* differences have to be (P = 2^b):
//! ```text
//!     g = M_b(d_x y),   d_x x = g + n P,   d_y n = (M_b(d_y g) - d_y g) / P   if |d_x d_y x| < P/2
//! ```
//! 1. `gradient`: n down each column, up to a constant.
//! 2. `rows`: with it, `d_y k` is the wrap of `d_y y`, up to the sums along the row of the wraps of `d_x M_b(d_y y)`, which most rows do not
//!    have; rows are joined by a majority vote of their columns.
//! 3. `columns`: most of a column is flat, which gives its constant.
//! 4. `levels`, `output`: the absolute offset, as for every method, and the result.
//!
//! Codes and counts are words that wrap by themselves, of 8 bits if these hold all counts. Steps 1 and 2 are one
//! pass over y, row by row, all channels together, which also computes the [`QualityMetrics`].
//!
//! It is exact when `|d_x d_y x| < P/2` everywhere and, in each column and row, most differences to the neighbour
//! are below P/2, or, where an edge runs along most of a line, `|d_x d_x x|` and `|d_y d_y x| < P/2` along most
//! of it. It fails on edges of a sharp lens: an edge of more than P/2 that ends within the image breaks the
//! condition at its end, and the error runs along the line. Hot pixels leave streaks.

mod columns;
mod gradient;
mod layout;
mod levels;
mod majority;
mod output;
mod rows;

use columns::ColumnConstants;
use gradient::Gradient;
use layout::{CodeRows, RowLayout, share};
use levels::Levels;
use output::Output;
use rows::Rows;

use super::congruence::OUTLIERS;
use super::wrapped::Word;
use super::{Integers, QualityMetrics, Range, Recovered, Scene, Unwrap, UnwrapError};
use crate::frame::Frame;
use crate::simd::widest;

/// The largest wrap count for which words of 8 bits, which hold twice as many lanes as those of 16, hold every k and errors
/// of the same size.
const NARROW: u8 = 63;

/// The number of rows after which an image is looked at for steep loops.
const PAUSE: usize = 16;

/// The method with its buffers, one channel after the other, in O(pixels).
#[derive(Default)]
pub struct Lines {
    bytes: Buffers<i8>,
    words: Buffers<i16>,
    pub(super) leaves_out_radiance: bool,
}

/// The part of an image that a scan has read.
pub(super) enum Scanned {
    /// So many rows, the last ones of which have a steep loop.
    ToSteep(usize),
    /// All rows, with the metrics that depend on y alone.
    Whole(QualityMetrics),
}

impl Lines {
    /// Reads the rows of `y` from row `from` on; [`Self::scan`] has summed those before. Once more than the share `most` of the loops is
    /// steep, rows are no longer summed, and [`Self::finish`] must not follow.
    ///
    /// # Errors
    /// Those of [`Unwrap::unwrap`].
    pub(super) fn scan_from(
        &mut self,
        from: usize,
        y: &Frame,
        range: Range,
        most: f64,
    ) -> Result<QualityMetrics, UnwrapError> {
        match self.scan(from, y, range, Some(most))? {
            Scanned::Whole(quality) => Ok(quality),
            Scanned::ToSteep(_) => unreachable!("a scan with a limit reads all rows"),
        }
    }

    /// Takes the first steps for the rows of `y` from row `from` on, which need not the whole range. Without the share `most`, it ends after the
    /// first rows with a steep loop; with it, as [`Self::scan_from`].
    ///
    /// # Errors
    /// Those of [`Unwrap::unwrap`].
    pub(super) fn scan(
        &mut self,
        from: usize,
        y: &Frame,
        range: Range,
        most: Option<f64>,
    ) -> Result<Scanned, UnwrapError> {
        let layout = RowLayout::of(y);
        Ok(match Integers::checked(y, range)? {
            Integers::U8(codes) if range.max_wraps() <= NARROW => {
                self.bytes.scan(&CodeRows::new(codes, layout, range), range, from, most)
            }
            Integers::U8(codes) => self.words.scan(&CodeRows::new(codes, layout, range), range, from, most),
            Integers::U16(codes) => self.words.scan(&CodeRows::new(codes, layout, range), range, from, most),
        })
    }

    /// Takes the last steps for the image whose rows were summed; a share of `outliers` may be below the least count.
    ///
    /// # Errors
    /// Those of [`Unwrap::unwrap`].
    pub(super) fn finish(
        &mut self,
        y: &Frame,
        range: Range,
        outliers: f64,
        out: &mut Recovered,
    ) -> Result<(), UnwrapError> {
        out.prepare(y.dim(), self.name());
        if self.leaves_out_radiance {
            out.leave_out();
        }
        let layout = RowLayout::of(y);
        match Integers::of(y, range)? {
            Integers::U8(codes) if range.max_wraps() <= NARROW => {
                self.bytes.finish(&CodeRows::new(codes, layout, range), range, outliers, out)
            }
            Integers::U8(codes) => {
                self.words.finish(&CodeRows::new(codes, layout, range), range, outliers, out)
            }
            Integers::U16(codes) => {
                self.words.finish(&CodeRows::new(codes, layout, range), range, outliers, out)
            }
        }
        Ok(())
    }
}

impl Unwrap for Lines {
    fn name(&self) -> &'static str {
        "lines"
    }

    fn unwrap(&mut self, y: &Frame, scene: &Scene, out: &mut Recovered) -> Result<(), UnwrapError> {
        self.leaves_out_radiance = !scene.radiance;
        self.scan_from(0, y, scene.range, f64::INFINITY)?;
        self.finish(y, scene.range, OUTLIERS, out)
    }
}

/// The buffers for codes in words of one width.
#[derive(Default)]
struct Buffers<W: Word> {
    /// The current row, the one above, and the one above that.
    codes: [Vec<W>; 3],
    gradient: Gradient<W>,
    rows: Rows<W>,
    constants: ColumnConstants<W>,
    offsets: Vec<W>,
    counts: Vec<usize>,
    output: Output<W>,
}

impl<W: Word> Buffers<W> {
    /// Reads the rows from row `from` on, and sums them as long as at most the share `most` of the loops is steep. Without `most`, it
    /// ends after the first rows with a steep loop.
    fn scan<S: Copy + Into<u16>>(
        &mut self,
        samples: &CodeRows<'_, S>,
        range: Range,
        from: usize,
        most: Option<f64>,
    ) -> Scanned {
        let layout = samples.layout;
        if from == 0 {
            // Half a peak, whose word is 0, is above the first row: every code follows it without a wrap.
            self.codes[0].clear();
            self.codes[0].resize(layout.lanes() + layout.channels, W::default());
            self.gradient.start(layout);
            self.rows.start(layout, range);
        }
        let mut sums = true;
        for i in from..layout.height {
            widest!(self.take_row(i, samples, sums));
            let rows = i + 1;
            if rows % PAUSE == 0 || rows == layout.height {
                match most {
                    None if self.gradient.suspect > 0 => return Scanned::ToSteep(rows),
                    None => {}
                    Some(most) => sums = f64::from(layout.share_of_loops(self.gradient.suspect)) <= most,
                }
            }
        }
        widest!(self.gradient.settle());
        Scanned::Whole(self.quality(layout, 0, 0))
    }

    fn finish<S: Copy + Into<u16>>(
        &mut self,
        samples: &CodeRows<'_, S>,
        range: Range,
        outliers: f64,
        out: &mut Recovered,
    ) {
        let layout = samples.layout;
        self.constants.find(&self.gradient, samples, range);
        let levels = Levels { layout, rows: &self.rows, constants: &self.constants.sums };
        let Self { offsets, counts, output, .. } = self;
        let (outside, differences) = widest!({
            let zero = levels.zero(range, outliers, counts);
            (zero.outside, levels.write(samples, &zero, range, (offsets, output), out))
        });
        out.report.quality = Some(self.quality(layout, outside, differences.jumps));
        out.near_half = Some(differences.near_half);
    }

    #[inline(always)]
    fn take_row<S: Copy + Into<u16>>(&mut self, i: usize, samples: &CodeRows<'_, S>, sums: bool) {
        self.codes.rotate_right(1);
        samples.read(i, &mut self.codes[0]);
        let [here, up, upper] = &self.codes;
        self.rows.append(i, [here, up, upper], &mut self.gradient, sums);
    }

    fn quality(&self, layout: RowLayout, outside: usize, jumps: u64) -> QualityMetrics {
        let RowLayout { height, width, channels } = layout;
        QualityMetrics {
            residues: layout.share_of_loops(self.gradient.residues),
            steep: layout.share_of_loops(self.gradient.suspect),
            clamped: share(outside, height * width * channels),
            jumps: share(jumps as usize, height * width * channels),
            defects: 0.0,
        }
    }
}
