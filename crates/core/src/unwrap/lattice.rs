//! The green pixels of a mosaic as an image of their own, with both other colours beside them.
//!
//! They form a square lattice that is turned by 45 degrees, with sides of sqrt(2) px. Along its rows and columns a method works on it as on
//! any image. At each green pixel, one of the other colours is the mean of the neighbours to the left and right, and the other one is
//! the mean of the neighbours above and below. The mean of two wrapped samples is right where they differ by less than half a peak.

use ndarray::Array3;

use super::mosaic_image::{MosaicImage, frame};
use super::{Range, Recovered};
use crate::frame::Frame;
use crate::mosaic::{GREEN, mirrored};

/// Pixels beyond the border of the image that belong to the lattice. Beyond them, its rows repeat their last pixel.
const MARGIN: isize = 2;

/// Pixels of the mirror image around the image: the margin and the neighbours of its pixels.
const PADDING: usize = MARGIN as usize + 1;

/// Returns the width of an image with its mirror image around it.
fn padded_width(image: &MosaicImage) -> usize {
    image.width + 2 * PADDING
}

/// Returns the image with [`PADDING`] pixels of its mirror image around it, in which all colours keep their places.
fn padded<T: Copy>(image: &[T], height: usize, width: usize) -> Vec<T> {
    let around = |count: usize| {
        (0..count + 2 * PADDING).map(move |at| mirrored(at as isize - PADDING as isize, count))
    };
    let columns: Vec<usize> = around(width).collect();
    around(height).flat_map(|row| columns.iter().map(move |&column| image[row * width + column])).collect()
}

/// The wrapped samples of the other colours at each pixel with the mirror image around it, of which only those at green pixels
/// have a meaning: the mean of the neighbours in the row, and of those in the column.
pub(super) struct Others {
    along: Vec<u16>,
    across: Vec<u16>,
}

impl Others {
    /// Takes the samples from wrapped codes.
    pub fn wrapped(image: &MosaicImage, range: Range) -> Self {
        let shift = 16 - range.bits();
        let codes: Vec<u16> =
            padded(&image.codes, image.height, image.width).iter().map(|y| y << shift).collect();
        // In the upper bits of a word, half of the signed difference is half of the wrapped one.
        let mean =
            |a: u16, b: u16| a.wrapping_add((b.wrapping_sub(a).cast_signed() >> 1).cast_unsigned()) >> shift;
        Self::between(&codes, padded_width(image), mean)
    }

    /// Takes the samples from known radiance.
    pub fn known(image: &MosaicImage, out: &Recovered, range: Range) -> Self {
        let mask = (1 << range.bits()) - 1;
        let x = padded(
            out.x.as_slice().expect("prepare has made the layout standard"),
            image.height,
            image.width,
        );
        Self::between(&x, padded_width(image), |a, b| ((0.5 * (a + b)) as u32 & mask) as u16)
    }

    /// Takes the means of the neighbours of each pixel.
    fn between<T: Copy>(image: &[T], width: usize, mean: impl Fn(T, T) -> u16) -> Self {
        let of_distance = |distance: usize| {
            let mut means = vec![0; image.len()];
            let neighbours = image.iter().zip(&image[2 * distance..]);
            means[distance..].iter_mut().zip(neighbours).for_each(|(to, (&a, &b))| *to = mean(a, b));
            means
        };
        // A green pixel has one colour beside it, and the other one above and below.
        Self { along: of_distance(1), across: of_distance(width) }
    }
}

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
    pub fn new(image: &MosaicImage) -> Self {
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
    pub fn frame(&self, image: &MosaicImage, others: &Others, range: Range) -> Frame {
        let green = padded(&image.codes, image.height, image.width);
        let (padding, width) = (PADDING.cast_signed(), padded_width(image).cast_signed());
        let red_row = image.mosaic.red().0.cast_signed();
        let mut pixels = Vec::with_capacity(3 * self.rows * self.columns);
        for b in (self.first..).take(self.rows) {
            let (least, most) = self.inside(b);
            // The next pixel of a row is one row and one column further.
            pixels.extend((0..self.columns.cast_signed()).flat_map(|a| {
                let a = a.clamp(least - MARGIN, most + MARGIN);
                let (row, column) = (a - b, a + b + self.parity);
                let at = ((row + padding) * width + column + padding).cast_unsigned();
                // In a row with red pixels, red lies beside green, and blue above and below it.
                match row & 1 == red_row {
                    true => [others.along[at], green[at], others.across[at]],
                    false => [others.across[at], green[at], others.along[at]],
                }
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
            let image = MosaicImage { codes: vec![0; height * width], height, width, mosaic };
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
