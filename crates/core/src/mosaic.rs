//! Colour mosaics: the colour filters of a sensor with one chip, whose pixels see one colour each.
//!
//! [`Mosaic::demosaic`] interpolates the two other colours with the linear filters of 5 x 5 pixels of Malvar, He and Cutler
//! (2004, *High-quality linear interpolation for demosaicing of Bayer-patterned color images*, ICASSP).

use ndarray::{Array3, ArrayView3};

use crate::simd::widest;

/// The order of the colours in each 2 x 2 pixels of a Bayer mosaic, from the upper left pixel along the rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mosaic {
    /// Red and green in even rows (from 0), green and blue in odd rows.
    Rggb,
    /// Blue and green in even rows, green and red in odd rows.
    Bggr,
    /// Green and red in even rows, blue and green in odd rows.
    Grbg,
    /// Green and blue in even rows, red and green in odd rows.
    Gbrg,
}

pub(crate) const GREEN: usize = 1;

/// The row and column of each pixel in the 2 x 2 pixels of a mosaic.
pub(crate) const PLACES: [(usize, usize); 4] = [(0, 0), (0, 1), (1, 0), (1, 1)];

/// Pixels that the filters reach to each side.
const REACH: usize = 2;

impl Mosaic {
    /// The mosaics with their words; `None` stands for three colours at each pixel.
    pub const WORDS: [(&'static str, Option<Self>); 5] = [
        ("none", None),
        ("rggb", Some(Self::Rggb)),
        ("bggr", Some(Self::Bggr)),
        ("grbg", Some(Self::Grbg)),
        ("gbrg", Some(Self::Gbrg)),
    ];

    /// Returns the word of the mosaic, as in [`Mosaic::WORDS`].
    pub fn word(self) -> &'static str {
        let found = Self::WORDS.into_iter().find(|(_, mosaic)| *mosaic == Some(self));
        found.expect("each mosaic has a word").0
    }

    /// Returns the row and column, 0 or 1, of the red pixel in each 2 x 2 pixels. The blue one is diagonally opposite.
    pub fn red(self) -> (usize, usize) {
        match self {
            Self::Rggb => (0, 0),
            Self::Bggr => (1, 1),
            Self::Grbg => (0, 1),
            Self::Gbrg => (1, 0),
        }
    }

    /// Returns the channel that a pixel sees: 0 (red), 1 (green) or 2 (blue).
    pub fn channel(self, row: usize, column: usize) -> usize {
        let (red_row, red_column) = self.red();
        match ((row + red_row) % 2, (column + red_column) % 2) {
            (0, 0) => 0,
            (1, 1) => 2,
            _ => 1,
        }
    }

    /// Writes to `seen` (W) the channel that each pixel of a row sees of `light` (W x 3, interleaved).
    pub(crate) fn filter_row(self, row: usize, light: &[f32], seen: &mut [f32]) {
        let pixels = light.as_chunks::<3>().0.iter().zip(seen).enumerate();
        pixels.for_each(|(column, (pixel, seen))| *seen = pixel[self.channel(row, column)]);
    }

    /// Returns the three colours of each pixel, H x W x 3, from a mosaic image, H x W x 1. The colour that a pixel has seen stays as it
    /// is; the two others may lie beyond the range of the samples. Beyond the border lies the mirror image without the border
    /// pixel (`dcb|abcd`), in which all colours keep their places.
    pub fn demosaic(self, image: ArrayView3<'_, f32>) -> Array3<f32> {
        let (height, width, _) = image.dim();
        let image = image.as_standard_layout();
        let samples = image.as_slice().expect("the array is in standard layout");
        let mut rows: [Vec<f32>; 2 * REACH + 1] = Default::default();
        let mut filtered = Filtered::default();
        let mut colours = Array3::zeros((height, width, 3));
        let pixels = colours.as_slice_mut().expect("a new array has the standard layout");
        for (row, pixels) in pixels.chunks_exact_mut(3 * width).enumerate() {
            for (down, padded) in (-(REACH as isize)..).zip(&mut rows) {
                let from = mirrored(row as isize + down, height) * width;
                pad(&samples[from..][..width], padded);
            }
            filtered.filter(&rows, width);
            self.choose(row, &rows[REACH][REACH..], &filtered, pixels.as_chunks_mut().0);
        }
        colours
    }

    /// Takes for each pixel of a row the filters that belong to its place in the mosaic.
    fn choose(self, row: usize, seen: &[f32], filtered: &Filtered, pixels: &mut [[f32; 3]]) {
        let Filtered { green, along, across, opposite } = filtered;
        for (column, pixel) in pixels.iter_mut().enumerate() {
            let (own, at) = (self.channel(row, column), column);
            // A green pixel has one of the other colours beside it, and the other one above and below.
            let beside = if own == 1 { self.channel(row, column + 1) } else { 2 - own };
            *pixel = match own {
                1 if beside == 0 => [along[at], seen[at], across[at]],
                1 => [across[at], seen[at], along[at]],
                0 => [seen[at], green[at], opposite[at]],
                _ => [opposite[at], green[at], seen[at]],
            };
        }
    }
}

/// Every filter at every pixel of a row: which of them belongs to a pixel is decided afterwards, so that vectors need not
/// separate the colours.
#[derive(Default)]
struct Filtered {
    /// Green at a red or blue pixel.
    green: Vec<f32>,
    /// At a green pixel the colour of its neighbours in the row.
    along: Vec<f32>,
    /// At a green pixel the colour of its neighbours in the column.
    across: Vec<f32>,
    /// Blue at a red pixel, and red at a blue one.
    opposite: Vec<f32>,
}

impl Filtered {
    /// Filters the middle one of the rows, which have [`REACH`] pixels more at both ends.
    fn filter(&mut self, rows: &[Vec<f32>; 2 * REACH + 1], width: usize) {
        for line in [&mut self.green, &mut self.along, &mut self.across, &mut self.opposite] {
            line.resize(width, 0.0);
        }
        let at = |row: usize, column: usize| &rows[row][column..][..width];
        let near = at(1, 2).iter().zip(at(3, 2)).zip(at(2, 1).iter().zip(at(2, 3)));
        let far = at(0, 2).iter().zip(at(4, 2)).zip(at(2, 0).iter().zip(at(2, 4)));
        let diagonal = at(1, 1).iter().zip(at(1, 3)).zip(at(3, 1).iter().zip(at(3, 3)));
        let to =
            self.green.iter_mut().zip(&mut self.along).zip(self.across.iter_mut().zip(&mut self.opposite));
        let inputs = at(2, 2).iter().zip(near).zip(far.zip(diagonal));
        widest!(to.zip(inputs).for_each(
            |(((green, along), (across, opposite)), ((here, near), (far, diagonal)))| {
                let (near_column, near_row) = (near.0.0 + near.0.1, near.1.0 + near.1.1);
                let (far_column, far_row) = (far.0.0 + far.0.1, far.1.0 + far.1.1);
                let corners = diagonal.0.0 + diagonal.0.1 + diagonal.1.0 + diagonal.1.1;
                *green = (4.0 * here + 2.0 * (near_column + near_row) - far_column - far_row) / 8.0;
                *along = (5.0 * here + 4.0 * near_row - far_row - corners + 0.5 * far_column) / 8.0;
                *across = (5.0 * here + 4.0 * near_column - far_column - corners + 0.5 * far_row) / 8.0;
                *opposite = (6.0 * here + 2.0 * corners - 1.5 * (far_column + far_row)) / 8.0;
            }
        ));
    }
}

/// Returns the row or column of `count` that lies at `at` when the image is continued by its mirror image without the border
/// pixel (`dcb|abcd`), in which all colours keep their places.
pub(crate) fn mirrored(at: isize, count: usize) -> usize {
    let last = count as isize - 1;
    if (0..=last).contains(&at) {
        return at.cast_unsigned();
    } else if last == 0 {
        return 0;
    }
    let at = at.rem_euclid(2 * last);
    at.min(2 * last - at).cast_unsigned()
}

/// Writes a row with [`REACH`] pixels of its mirror image at both ends.
fn pad<T: Copy + Into<f32>>(row: &[T], padded: &mut Vec<f32>) {
    let (reach, width) = (REACH as isize, row.len() as isize);
    padded.clear();
    padded.extend((-reach..0).map(|at| row[mirrored(at, row.len())].into()));
    padded.extend(row.iter().map(|&sample| sample.into()));
    padded.extend((width..width + reach).map(|at| row[mirrored(at, row.len())].into()));
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Frame;

    /// The mosaic image of three colours.
    fn seen(mosaic: Mosaic, colours: &Array3<f32>) -> Array3<f32> {
        let (height, width, _) = colours.dim();
        Array3::from_shape_fn((height, width, 1), |(i, j, _)| colours[(i, j, mosaic.channel(i, j))])
    }

    proptest! {
        #[test]
        fn the_colours_of_a_pattern_are_those_of_its_word(row in 0usize..9, column in 0usize..9) {
            for (word, mosaic) in Mosaic::WORDS.iter().skip(1) {
                let letter = word.as_bytes()[2 * (row % 2) + column % 2];
                let channel = b"rgb".iter().position(|&colour| colour == letter);
                prop_assert_eq!(mosaic.map(|mosaic| mosaic.channel(row, column)), channel);
            }
        }

        #[test]
        fn a_linear_field_in_grey_light_comes_back(
            (height, width) in (5usize..12, 5usize..12), slopes in (-9i8..9, -9i8..9), which in 1usize..5,
        ) {
            let mosaic = Mosaic::WORDS[which].1.unwrap();
            let colours = Array3::from_shape_fn((height, width, 3), |(i, j, _)| {
                f32::from(slopes.0) * i as f32 + f32::from(slopes.1) * j as f32 + 300.0
            });
            let got = mosaic.demosaic(seen(mosaic, &colours).view());
            for ((i, j, c), value) in got.indexed_iter() {
                let inside = (2..height - 2).contains(&i) && (2..width - 2).contains(&j);
                prop_assert!(!inside || (value - colours[(i, j, c)]).abs() < 1e-2, "({i}, {j}, {c})");
            }
        }

        #[test]
        fn a_uniform_colour_comes_back_everywhere(
            (height, width) in (2usize..7, 2usize..7), colour in [0f32..999.0, 0f32..999.0, 0f32..999.0], which in 1usize..5,
        ) {
            let mosaic = Mosaic::WORDS[which].1.unwrap();
            let colours = Array3::from_shape_fn((height, width, 3), |(.., c)| colour[c]);
            let got = mosaic.demosaic(seen(mosaic, &colours).view());
            prop_assert!(got.iter().zip(&colours).all(|(got, colour)| (got - colour).abs() < 1e-2));
        }
    }

    #[test]
    fn beyond_the_border_lies_the_mirror_image() {
        assert_eq!((-3..6).map(|at| mirrored(at, 3)).collect::<Vec<_>>(), [1, 2, 1, 0, 1, 2, 1, 0, 1]);
        assert_eq!(mirrored(-2, 1), 0);
    }

    #[test]
    fn integers_are_rounded_and_clamped() {
        // A single bright red pixel: the filter for green takes an eighth of the far pixels away from dark ones.
        let mut image = Array3::zeros((6, 6, 1));
        image[(2, 2, 0)] = 200u8;
        let frame = Frame::from_u8(image).unwrap().with_mosaic(Mosaic::Rggb).unwrap();
        let colours = frame.demosaiced();
        let pixels = colours.as_u8().unwrap();
        assert_eq!((pixels[(2, 2, 0)], pixels[(2, 2, 1)], pixels[(2, 4, 1)]), (200, 100, 0));
        assert_eq!(colours.mosaic(), None);
    }
}
