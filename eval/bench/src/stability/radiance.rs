//! [`Radiance`]: the generators of the scenes of the catalogue.
//!
//! Noise of the sensor is never drawn here. Random content depends only on a seed.

use std::ops::Range;

use modulo_core::Transfer;
use modulo_scene::{Preset, Scene};
use ndarray::{Array2, Array3, Zip, s};

/// Number of rows and columns of most scenes.
pub const SIZE: (usize, usize) = (192, 320);

/// Red, green and blue light of most scenes: slightly different, so that the channels wrap at different pixels.
const WARM: [f64; 3] = [1.0, 0.95, 0.9];

/// Radiance without colour, H x W, in codes of an 8-bit sensor (256 = one peak).
#[derive(Clone)]
pub struct Radiance(Array2<f64>);

impl Radiance {
    /// The background: `60 + 40 sin(column / 50) + 30 row / H`, 20 to 130 codes, nowhere steep.
    pub fn dusk(height: usize, width: usize) -> Self {
        Self(Array2::from_shape_fn((height, width), |(row, column)| {
            60.0 + 40.0 * (column as f64 / 50.0).sin() + 30.0 * row as f64 / height as f64
        }))
    }

    /// [`Radiance::dusk`] with [`SIZE`].
    pub fn evening() -> Self {
        Self::dusk(SIZE.0, SIZE.1)
    }

    /// A constant image of `codes` with [`SIZE`].
    pub fn even(codes: f64) -> Self {
        Self(Array2::from_elem(SIZE, codes))
    }

    /// 0 up to column 40, then a ramp of `codes` a column over 40 columns, then constant; with [`SIZE`].
    pub fn ramp(codes: f64) -> Self {
        Self(Array2::from_shape_fn(SIZE, |(_, column)| codes * column.clamp(40, 80).abs_diff(40) as f64))
    }

    /// Multiplies all values by `factor`.
    pub fn times(self, factor: f64) -> Self {
        Self(self.0 * factor)
    }

    /// Takes all values for codes of a picture with `full_scale` codes, and decodes them into radiance.
    pub fn decoded(self, transfer: Transfer, full_scale: f64) -> Self {
        Self(self.0.mapv(|codes| full_scale * transfer.decode(codes / full_scale)))
    }

    /// Adds a slope from 0 at the left to `codes` at the right edge.
    pub fn slope(self, codes: f64) -> Self {
        let width = self.0.ncols() as f64;
        self.add(|_, column| codes * column as f64 / width)
    }

    /// Adds `codes` in a rectangle, which is clipped to the image.
    pub fn block(self, rows: Range<usize>, columns: Range<usize>, codes: f64) -> Self {
        self.add(|row, column| if rows.contains(&row) && columns.contains(&column) { codes } else { 0.0 })
    }

    /// Adds `codes` from `column` to the right edge, over all rows.
    pub fn step(self, column: usize, codes: f64) -> Self {
        self.block(0..usize::MAX, column..usize::MAX, codes)
    }

    /// Adds a sky: `codes` above `row`.
    pub fn sky(self, row: usize, codes: f64) -> Self {
        self.block(0..row, 0..usize::MAX, codes)
    }

    /// Adds `codes` in `width` columns from `column`, over all rows.
    pub fn pole(self, column: usize, width: usize, codes: f64) -> Self {
        self.block(0..usize::MAX, column..column + width, codes)
    }

    /// Adds `codes` in the first `width` of every `period` columns.
    pub fn fence(self, period: usize, width: usize, codes: f64) -> Self {
        self.add(|_, column| if column % period < width { codes } else { 0.0 })
    }

    /// Adds a disc with a sharp edge: `codes` where the distance to (`row`, `column`) is below `radius`.
    pub fn disc(self, row: usize, column: usize, radius: f64, codes: f64) -> Self {
        self.add(|i, j| if distance((i, j), (row, column)) < radius { codes } else { 0.0 })
    }

    /// Adds glare: `codes / (1 + (d / radius)^2)` at the distance d from (`row`, `column`).
    pub fn glare(self, row: usize, column: usize, radius: f64, codes: f64) -> Self {
        self.add(|i, j| codes / (1.0 + (distance((i, j), (row, column)) / radius).powi(2)))
    }

    /// Adds `codes` at random pixels, about `share` of all, which depend on `seed`.
    pub fn hot(self, share: f64, codes: f64, seed: u64) -> Self {
        let width = self.0.ncols();
        self.add(
            |row, column| {
                if fraction(seed, (row * width + column) as u64) < share { codes } else { 0.0 }
            },
        )
    }

    /// Motion blur: the mean over `length` (odd) pixels of a row, with the edge pixel repeated.
    pub fn motion(self, length: usize) -> Self {
        let (still, reach) = (self.0, length / 2);
        let last = still.ncols().saturating_sub(1);
        Self(Array2::from_shape_fn(still.dim(), |(row, column)| {
            let along = (0..length).map(|step| (column + step).saturating_sub(reach).min(last));
            along.map(|from| still[(row, from)]).sum::<f64>() / length as f64
        }))
    }

    /// The image with one channel.
    pub fn mono(self) -> Array3<f32> {
        self.lit(&[1.0])
    }

    /// The image with three equal channels.
    pub fn white(self) -> Array3<f32> {
        self.lit(&[1.0; 3])
    }

    /// The image in warm light.
    pub fn warm(self) -> Array3<f32> {
        self.lit(&WARM)
    }

    fn lit(self, light: &[f64]) -> Array3<f32> {
        let (height, width) = self.0.dim();
        Array3::from_shape_fn((height, width, light.len()), |(row, column, channel)| {
            (self.0[(row, column)] * light[channel]) as f32
        })
    }

    fn add(mut self, codes: impl Fn(usize, usize) -> f64) -> Self {
        Zip::indexed(&mut self.0).for_each(|(row, column), value| *value += codes(row, column));
        self
    }
}

/// Adds a red lamp: `codes` in a rectangle of the red channel.
pub fn red_block(
    mut image: Array3<f32>,
    rows: Range<usize>,
    columns: Range<usize>,
    codes: f32,
) -> Array3<f32> {
    image.slice_mut(s![rows, columns, 0]).mapv_inplace(|value| value + codes);
    image
}

/// Chromatic aberration: shifts the red channel `columns` to the right, with the edge pixel repeated.
pub fn shift_red(image: Array3<f32>, columns: usize) -> Array3<f32> {
    Array3::from_shape_fn(image.dim(), |(row, column, channel)| {
        let from = if channel == 0 { column.saturating_sub(columns) } else { column };
        image[(row, from, channel)]
    })
}

/// The rendered driving scene of `preset` with seed 0 and full scale `alpha` peaks, in the unit of [`Radiance`].
pub fn rendered(preset: Preset, alpha: f64) -> Array3<f32> {
    let full = (256.0 * alpha) as f32;
    Scene::new(preset, 0).render(0, SIZE.0, SIZE.1).radiance.mapv_into(|value| value * full)
}

fn distance(a: (usize, usize), b: (usize, usize)) -> f64 {
    (a.0.abs_diff(b.0) as f64).hypot(a.1.abs_diff(b.1) as f64)
}

/// The `index`-th random number in [0, 1) of `seed` by SplitMix64 (Steele, Lea and Flood 2014).
fn fraction(seed: u64, index: u64) -> f64 {
    // A hash of seed and pixel, instead of a sequence of random numbers: the value of a pixel does not depend on the
    // order in which the pixels are drawn. The upper 53 bits are the mantissa of a double.
    let state = (seed << 32).wrapping_add(index + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mixed = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((mixed ^ (mixed >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hot_pixels_follow_from_the_seed() {
        let draw = |seed| Radiance::even(0.0).hot(0.01, 1.0, seed).mono();
        assert_eq!(draw(1), draw(1));
        assert!(draw(1) != draw(2));
        let share = draw(3).mean().expect("the image has pixels");
        assert!((share - 0.01).abs() < 0.002, "{share}");
    }

    #[test]
    fn motion_keeps_what_is_even_and_spreads_a_line() {
        let line = Radiance::even(7.0).pole(100, 1, 15.0).motion(15).mono();
        assert_eq!(
            (line[(5, 92, 0)], line[(5, 93, 0)], line[(5, 107, 0)], line[(5, 108, 0)]),
            (7.0, 8.0, 8.0, 7.0)
        );
    }

    #[test]
    fn red_moves_alone() {
        let image = shift_red(Radiance::ramp(1.0).white(), 3);
        assert_eq!((image[(0, 0, 0)], image[(0, 50, 0)], image[(0, 50, 1)]), (0.0, 7.0, 10.0));
    }
}
