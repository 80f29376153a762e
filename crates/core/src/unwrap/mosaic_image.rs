//! The codes of a colour mosaic, and where its green pixels are.

use ndarray::Array3;

use super::{Range, Recovered};
use crate::frame::Frame;
use crate::mosaic::{Mosaic, mirrored};
use crate::simd::widest;

/// The codes of a mosaic image, row-major.
pub(super) struct MosaicImage<'a> {
    pub codes: &'a [u16],
    pub height: usize,
    pub width: usize,
    pub mosaic: Mosaic,
}

impl MosaicImage<'_> {
    /// Returns the code of a pixel, which may lie beyond the border in the mirror image.
    pub fn code(&self, row: isize, column: isize) -> u16 {
        self.codes[mirrored(row, self.height) * self.width + mirrored(column, self.width)]
    }

    /// Writes counts, of which `zero` stands for 0, to every second pixel of a row from (row, column) on; returns how many were out of range.
    pub fn write_row(
        &self,
        (row, first): (usize, usize),
        (counts, zero): (&[i32], i32),
        range: Range,
        out: &mut Recovered,
    ) -> usize {
        let (from, most, peak) = (row * self.width, i32::from(range.max_wraps()), range.peak());
        let (x, k) = out.buffers();
        let codes = &self.codes[from..][..self.width];
        let (x, k) = (&mut x[from..][..self.width], &mut k[from..][..self.width]);
        let outside = widest!(set_counts(counts, (zero, most), &mut k[first..]));
        // The pixels beside get the radiance of the counts that they have: vectors do not leave out single ones.
        widest!(for ((x, k), code) in x.iter_mut().zip(&*k).zip(codes) {
            *x = f32::from(*code) + f32::from(*k) * peak;
        });
        outside as usize
    }

    /// Returns the sum of row and column of the green pixels, modulo 2.
    pub fn parity(&self) -> usize {
        let (row, column) = self.mosaic.red();
        // Beside red there is green.
        (row + column + 1) % 2
    }
}

/// Writes counts, of which `zero` stands for 0, to the first sample and every second one after it; returns how many were out of range.
#[inline(always)]
fn set_counts(counts: &[i32], (zero, most): (i32, i32), k: &mut [u8]) -> u32 {
    let mut outside = 0;
    let mut inside = |count: i32| {
        let inside = (count - zero).max(0).min(most);
        outside += u32::from(inside != count - zero);
        inside as u8
    };
    let (pairs, last) = k.as_chunks_mut::<2>();
    for (pair, count) in pairs.iter_mut().zip(counts) {
        *pair = [inside(*count), pair[1]];
    }
    if let ([k], [.., count]) = (last, counts) {
        *k = inside(*count);
    }
    outside
}

/// Returns codes of 8 bits where they fit, which methods unwrap faster.
pub(super) fn frame(codes: Array3<u16>, range: Range) -> Frame {
    let frame = if range.bits() <= 8 {
        Frame::from_u8(codes.mapv(|code| code as u8))
    } else {
        Frame::from_u16(codes)
    };
    frame.expect("the shape is that of an image")
}
