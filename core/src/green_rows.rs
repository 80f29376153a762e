//! The samples of green beside what red and blue say at their place, for sensors with a gain per colour
//! ([`GainPattern::Colours`](crate::GainPattern::Colours)).
//!
//! Where each pixel sees all colours, red and blue are those of the pixel. On a mosaic, a green pixel has two neighbours of one of
//! them in its row, and two of the other one in its column. Each is interpolated between its two neighbours, as curved as the other
//! one is in the lines beside:
//! ```text
//!     R(0) = (R(-1) + R(1)) / 2 - f'' / 2,   f'' = (B(-2) - 2 B(0) + B(2)) / 4, the mean of both lines
//! ```

use ndarray::Array3;

use crate::mosaic::{GREEN, Mosaic, REACH, mirrored, pad};
use crate::range::{HALF_A_CODE, Range};
use crate::simd::widest;

/// The codes of an image whose red and blue samples have the gain `ratio` and do not wrap.
#[derive(Clone, Copy)]
pub(crate) struct GreenRows<'a, T> {
    codes: &'a [T],
    height: usize,
    /// The samples of a row.
    stride: usize,
    mosaic: Option<Mosaic>,
    ratio: f32,
}

/// The green samples of a row and the radiance of red and blue at their places, in code units of full gain.
#[derive(Clone, Debug, Default)]
pub(crate) struct GreenRow {
    pub red: Vec<f32>,
    /// The codes of green.
    pub green: Vec<f32>,
    pub blue: Vec<f32>,
    /// For a mosaic: the codes of the row and of the two rows above and below it, with their mirror images.
    lines: [Vec<f32>; 2 * REACH + 1],
    /// For a mosaic: the radiance between the neighbours of each pixel in its row, and in its column.
    between: [Vec<f32>; 2],
}

impl<'a, T: Copy + Into<f32>> GreenRows<'a, T> {
    /// Takes codes in row-major order, of the shape `dim`: three channels, or one with a mosaic.
    pub fn new(
        codes: &'a [T],
        (height, width, channels): (usize, usize, usize),
        mosaic: Option<Mosaic>,
        ratio: f64,
    ) -> Self {
        Self { codes, height, stride: width * channels, mosaic, ratio: ratio as f32 }
    }

    /// Returns the length of a [`GreenRow`]. On a mosaic of odd width, every second row has one green sample less, and repeats its
    /// last one.
    pub fn width(&self) -> usize {
        if self.mosaic.is_some() { self.stride.div_ceil(2) } else { self.stride / 3 }
    }

    /// Returns the first green sample of a row, and how far it is from one to the next.
    pub fn places(&self, row: usize) -> (usize, usize) {
        match self.mosaic {
            None => (GREEN, 3),
            Some(mosaic) => (usize::from(mosaic.channel(row, 0) != GREEN), 2),
        }
    }

    /// Reads a row.
    pub fn read(&self, row: usize, out: &mut GreenRow) {
        for line in [&mut out.red, &mut out.green, &mut out.blue] {
            line.resize(self.width(), 0.0);
        }
        match self.mosaic {
            None => self.read_pixels(row, out),
            Some(mosaic) => self.read_mosaic(row, mosaic, out),
        }
    }

    fn read_pixels(&self, row: usize, out: &mut GreenRow) {
        let pixels = self.line(row).as_chunks::<3>().0.iter();
        let lines = out.red.iter_mut().zip(&mut out.green).zip(&mut out.blue);
        let ratio = self.ratio;
        widest!(pixels.zip(lines).for_each(|(&[r, g, b], ((red, green), blue))| {
            (*red, *green, *blue) =
                (radiance_of_low(r.into(), ratio), g.into(), radiance_of_low(b.into(), ratio));
        }));
    }

    fn read_mosaic(&self, row: usize, mosaic: Mosaic, out: &mut GreenRow) {
        let GreenRow { red, green, blue, lines, between } = out;
        for (down, line) in (-(REACH as isize)..).zip(&mut *lines) {
            pad(self.line(mirrored(row.cast_signed() + down, self.height)), line);
        }
        interpolate(lines, between, self.stride, self.ratio);
        let (along, across) = if row % 2 == mosaic.red().0 { (red, blue) } else { (blue, red) };
        let (first, step) = self.places(row);
        for (to, from) in
            [(green, &lines[REACH][REACH..][..self.stride]), (along, &between[0]), (across, &between[1])]
        {
            let samples = from[first..].iter().step_by(step);
            to.clear();
            to.extend(samples.clone().chain(samples.rev()).take(self.width()));
        }
    }

    /// Writes the radiance of a row to `x`, whose green samples are `green`.
    pub fn write(&self, row: usize, green: &[f32], most: f32, x: &mut [f32]) {
        let (codes, ratio) = (self.line(row), self.ratio);
        widest!(
            x.iter_mut().zip(codes).for_each(|(x, &code)| *x = radiance_of_low(code.into(), ratio).min(most))
        );
        let (first, step) = self.places(row);
        x[first..].iter_mut().step_by(step).zip(green).for_each(|(x, green)| *x = *green);
    }

    /// Returns the codes of a row.
    pub fn line(&self, row: usize) -> &'a [T] {
        &self.codes[row * self.stride..][..self.stride]
    }
}

/// Writes the radiance of low gain between the left and right neighbours of each pixel of the middle line, and between those above and
/// below.
fn interpolate(lines: &[Vec<f32>; 2 * REACH + 1], between: &mut [Vec<f32>; 2], width: usize, ratio: f32) {
    let [along, across] = between;
    for line in [&mut *along, &mut *across] {
        line.resize(width, 0.0);
    }
    let at = |row: usize, column: usize| &lines[row][column..][..width];
    let near = at(2, 1).iter().zip(at(2, 3)).zip(at(1, 2).iter().zip(at(3, 2)));
    let beside = at(1, 0).iter().zip(at(1, 4)).zip(at(3, 0).iter().zip(at(3, 4)));
    let over = at(0, 1).iter().zip(at(4, 1)).zip(at(0, 3).iter().zip(at(4, 3)));
    let to = along.iter_mut().zip(across).zip(near.zip(beside.zip(over)));
    widest!(to.for_each(|((along, across), (((left, right), (above, below)), ((a, b), (c, d))))| {
        let bend_beside = a.0 + a.1 + b.0 + b.1 - 2.0 * (above + below);
        let bend_over = c.0 + c.1 + d.0 + d.1 - 2.0 * (left + right);
        *along = radiance_of_low(((left + right) / 2.0 - bend_beside / 16.0).max(0.0), ratio);
        *across = radiance_of_low(((above + below) / 2.0 - bend_over / 16.0).max(0.0), ratio);
    }));
}

/// Returns the radiance of a code of low gain. A code stands for the interval above it, and the radiance of full gain is a whole code,
/// too: the half codes cancel for a ratio of 1.
#[inline(always)]
pub(crate) fn radiance_of_low(code: f32, ratio: f32) -> f32 {
    (code + HALF_A_CODE) / ratio - HALF_A_CODE
}

/// Returns the radiance (in code units of full gain) of a sensor with a gain per colour whose green saturates at the peak: green that
/// saturates is the mean of red and blue, or the peak where that is more. `codes` are below 2^b.
pub(crate) fn fill_saturated(
    codes: Array3<f32>,
    mosaic: Option<Mosaic>,
    ratio: f64,
    range: Range,
) -> Array3<f32> {
    let (dim, most) = (codes.dim(), range.peak() - 1.0);
    let codes = codes.as_standard_layout();
    let rows = GreenRows::new(codes.as_slice().expect("the layout was made standard"), dim, mosaic, ratio);
    let mut x = Array3::zeros(dim);
    let mut row = GreenRow::default();
    for (at, x) in x.as_slice_mut().expect("it is new").chunks_exact_mut(rows.stride).enumerate() {
        rows.read(at, &mut row);
        let others = row.red.iter().zip(&row.blue);
        for (green, (red, blue)) in row.green.iter_mut().zip(others) {
            if *green >= most {
                *green = most.max((red + blue) / 2.0);
            }
        }
        rows.write(at, &row.green, f32::MAX, x);
    }
    x
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// The interpolation is exact for a parabola in grey light, and each green pixel is met once.
        #[test]
        fn on_a_mosaic_grey_light_is_red_and_blue_at_green(
            (height, width) in (2usize..12, 2usize..12), which in 1usize..5, terms in [-9i8..9, -9..9, -3..3, -3..3],
        ) {
            let mosaic = Mosaic::WORDS[which].1.unwrap();
            let [a, b, c, d] = terms.map(f32::from);
            let light = |i: usize, j: usize| {
                let (i, j) = (i as f32, j as f32);
                1000.0 + a * i + b * j + c * i * i + d * j * j
            };
            let codes: Vec<f32> = (0..height * width).map(|at| light(at / width, at % width)).collect();
            let rows = GreenRows::new(&codes, (height, width, 1), Some(mosaic), 1.0);
            let mut out = GreenRow::default();
            for row in 0..height {
                rows.read(row, &mut out);
                let (first, step) = rows.places(row);
                let columns: Vec<usize> = (first..width).step_by(step).collect();
                prop_assert!(columns.iter().all(|&column| mosaic.channel(row, column) == GREEN));
                prop_assert_eq!(columns.len(), (0..width).filter(|&c| mosaic.channel(row, c) == GREEN).count());
                prop_assert!(columns.len() + 1 >= rows.width() && columns.len() <= rows.width());
                prop_assert_eq!([out.red.len(), out.green.len(), out.blue.len()], [rows.width(); 3]);
                for (index, &column) in columns.iter().enumerate() {
                    prop_assert_eq!(out.green[index], light(row, column));
                    let is_inside = (2..height.saturating_sub(2)).contains(&row) && (2..width.saturating_sub(2)).contains(&column);
                    for other in [out.red[index], out.blue[index]] {
                        prop_assert!(!is_inside || (other - light(row, column)).abs() < 1e-2, "({}, {}): {}", row, column, other);
                    }
                }
            }
        }
    }

    #[test]
    fn green_that_saturates_is_the_mean_of_red_and_blue_but_not_below_the_peak() {
        let range = Range::new(8, 4.0).unwrap();
        for (red, green, blue, shown) in
            [(99.5, 254.0, 0.0, 254.0), (149.5, 255.0, 99.5, 499.5), (9.5, 255.0, 19.5, 255.0)]
        {
            let codes = ndarray::arr3(&[[[red, green, blue]]]);
            let x = fill_saturated(codes, None, 0.25, range);
            assert_eq!(x[(0, 0, 1)], shown);
            assert_eq!(x[(0, 0, 0)], 4.0 * (red + 0.5) - 0.5, "red has its own radiance");
        }
        let mosaic = ndarray::Array3::from_shape_fn((6, 6, 1), |(i, j, _)| {
            [124.5, 255.0][usize::from(Mosaic::Rggb.channel(i, j) == GREEN)]
        });
        let x = fill_saturated(mosaic, Some(Mosaic::Rggb), 0.25, range);
        assert!(x.iter().all(|x| *x == 499.5), "{x}");
    }
}
