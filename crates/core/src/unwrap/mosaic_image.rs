//! The codes of a colour mosaic, and where its green pixels are.

use ndarray::Array3;

use super::{Range, Recovered};
use crate::frame::Frame;
use crate::mosaic::{Mosaic, mirrored};

/// The codes of a mosaic image, row-major.
pub(super) struct MosaicImage {
    pub codes: Vec<u16>,
    pub height: usize,
    pub width: usize,
    pub mosaic: Mosaic,
}

impl MosaicImage {
    /// Returns the code of a pixel, which may lie beyond the border in the mirror image.
    pub fn code(&self, row: isize, column: isize) -> u16 {
        self.codes[mirrored(row, self.height) * self.width + mirrored(column, self.width)]
    }

    /// Writes counts to every second pixel of a row from (row, column) on; returns how many were out of range.
    pub fn write_row(
        &self,
        (row, first): (usize, usize),
        counts: impl Iterator<Item = i32>,
        range: Range,
        out: &mut Recovered,
    ) -> usize {
        let (from, most, peak) = (row * self.width, i32::from(range.max_wraps()), range.peak());
        let (x, k) = out.buffers();
        let codes = &self.codes[from..][..self.width];
        let (x, k) = (&mut x[from..][..self.width], &mut k[from..][..self.width]);
        let mut outside = 0;
        for (column, count) in (first..self.width).step_by(2).zip(counts) {
            let inside = count.clamp(0, most);
            outside += usize::from(inside != count);
            k[column] = inside as u8;
            x[column] = f32::from(codes[column]) + inside as f32 * peak;
        }
        outside
    }

    /// Returns the sum of row and column of the green pixels, modulo 2.
    pub fn parity(&self) -> usize {
        let (row, column) = self.mosaic.red();
        // Beside red there is green.
        (row + column + 1) % 2
    }
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
