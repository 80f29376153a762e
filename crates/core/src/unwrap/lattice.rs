//! The green pixels of a mosaic as an image of their own, with both other colours beside them.
//!
//! They form a square lattice that is turned by 45 degrees, with sides of sqrt(2) px. Along its rows and columns a method works on it as on
//! any image. At each green pixel, one of the other colours is the mean of the neighbours to the left and right, and the other one is
//! the mean of the neighbours above and below. The mean of two wrapped samples is right where they differ by less than half a peak.

use ndarray::Array3;

use super::mosaic_image::{MosaicImage, frame};
use super::{Range, Recovered};
use crate::frame::Frame;
use crate::mosaic::GREEN;

/// Pixels beyond the border of the image that belong to the lattice. Beyond them, its rows repeat their last pixel.
const MARGIN: isize = 2;

/// The lattice of the green pixels: row b and column a are the pixel in row `a - b` and column `a + b + parity`.
pub(super) struct Lattice {
    height: isize,
    width: isize,
    /// The sum of row and column of the green pixels, modulo 2.
    parity: isize,
    /// The number b of the first row.
    first: isize,
    pub rows: usize,
    pub columns: usize,
}

impl Lattice {
    pub fn new(image: &MosaicImage<'_>) -> Self {
        let [height, width] = [image.height, image.width].map(usize::cast_signed);
        let parity = image.parity().cast_signed();
        let first = -((height - 1 + parity) / 2);
        let last = (width - 1 - parity).div_euclid(2);
        let columns = ((height + width - 2 - parity) / 2 + 1).cast_unsigned();
        Self { height, width, parity, first, rows: (last - first + 1).cast_unsigned(), columns }
    }

    /// Returns the first and the last column of a row that lie in the image.
    fn inside(&self, b: isize) -> (isize, isize) {
        (b.max(-b - self.parity), (self.height - 1 + b).min(self.width - 1 - self.parity - b))
    }

    /// Returns green and the two other colours along the lattice.
    pub fn frame(&self, image: &MosaicImage<'_>, range: Range) -> Frame {
        let (shift, red_row) = (16 - range.bits(), image.mosaic.red().0.cast_signed());
        // In the upper bits of a word, half of the signed difference is half of the wrapped one.
        let mean = |a: u16, b: u16| {
            let (a, b) = (a << shift, b << shift);
            a.wrapping_add((b.wrapping_sub(a).cast_signed() >> 1).cast_unsigned()) >> shift
        };
        let mut pixels = Vec::with_capacity(3 * self.rows * self.columns);
        for b in (self.first..).take(self.rows) {
            let (least, most) = self.inside(b);
            // The next pixel of a row is one row and one column further.
            pixels.extend((0..self.columns.cast_signed()).flat_map(|a| {
                let a = a.clamp(least - MARGIN, most + MARGIN);
                let (row, column) = (a - b, a + b + self.parity);
                let along = mean(image.code(row, column - 1), image.code(row, column + 1));
                let across = mean(image.code(row - 1, column), image.code(row + 1, column));
                let green = image.code(row, column);
                // In a row with red pixels, red lies beside green, and blue above and below it.
                if row & 1 == red_row { [along, green, across] } else { [across, green, along] }
            }));
        }
        let pixels = Array3::from_shape_vec((self.rows, self.columns, 3), pixels);
        frame(pixels.expect("each row has its columns"), range)
    }

    /// Writes the green pixels of the lattice to the image.
    pub fn scatter(&self, green: &Recovered, out: &mut Recovered) {
        for (index, b) in (self.first..).take(self.rows).enumerate() {
            let (least, most) = self.inside(b);
            for a in least..=most {
                let at = ((a - b).cast_unsigned(), (a + b + self.parity).cast_unsigned(), 0);
                let from = (index, a.cast_unsigned(), GREEN);
                (out.x[at], out.k[at]) = (green.x[from], green.k[from]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Mosaic;

    proptest! {
        #[test]
        fn the_lattice_has_each_green_pixel_once(height in 2usize..12, width in 2usize..12, which in 1usize..5) {
            let mosaic = Mosaic::WORDS[which].1.unwrap();
            let image = MosaicImage { codes: &vec![0; height * width], height, width, mosaic };
            let lattice = Lattice::new(&image);
            let mut seen = Array3::<i32>::zeros((height, width, 1));
            for b in (lattice.first..).take(lattice.rows) {
                let (least, most) = lattice.inside(b);
                prop_assert!(least >= 0 && least <= most && most.cast_unsigned() < lattice.columns);
                for a in least..=most {
                    seen[((a - b).cast_unsigned(), (a + b + lattice.parity).cast_unsigned(), 0)] += 1;
                }
            }
            for ((i, j, _), &count) in seen.indexed_iter() {
                prop_assert_eq!(count, i32::from(mosaic.channel(i, j) == 1), "({}, {})", i, j);
            }
        }
    }
}
