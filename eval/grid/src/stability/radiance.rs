//! [`Draw`] and [`Light`]: how the radiance of a scene is drawn, in codes of an 8-bit sensor (256 = one peak).
//!
//! Noise of the sensor is never drawn here. Random content depends only on a seed.

use modulo_core::Transfer;
use modulo_scene::{Preset, Scene};
use ndarray::{Array2, Array3, s};
use serde::Deserialize;

/// Number of rows and columns of most scenes.
pub const SIZE: (usize, usize) = (192, 320);

/// The image that a drawing starts from.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Background {
    /// `60 + 40 sin(column / 50) + 30 row / H`: 20 to 130 codes, nowhere steep.
    #[default]
    Dusk,
    /// A constant image of these codes.
    Even(f64),
    /// 0 up to column 40, then a ramp of these codes a column over 40 columns, then constant.
    Ramp(f64),
    /// The rendered driving scene of the preset of this name with seed 0, in colour: full scale is alpha peaks.
    Rendered(String),
}

impl Background {
    /// The image without colour. A rendered scene has none.
    pub fn image(&self, (height, width): (usize, usize)) -> Array2<f64> {
        Array2::from_shape_fn((height, width), |(row, column)| match self {
            Self::Dusk => 60.0 + 40.0 * (column as f64 / 50.0).sin() + 30.0 * row as f64 / height as f64,
            Self::Even(codes) => *codes,
            Self::Ramp(codes) => codes * column.clamp(40, 80).abs_diff(40) as f64,
            Self::Rendered(_) => 0.0,
        })
    }
}

/// A change of an image without colour.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Draw {
    /// Multiplies all values by this factor.
    Times(f64),
    /// Takes all values for codes of a picture of sRGB with this full scale, and decodes them into radiance.
    Decoded(f64),
    /// Adds a slope from 0 at the left to these codes at the right edge.
    Slope(f64),
    /// Adds `codes` in a rectangle, from the first number of each pair up to the second; without a pair, all over the image.
    Block {
        #[serde(default = "everywhere")]
        rows: [usize; 2],
        #[serde(default = "everywhere")]
        columns: [usize; 2],
        codes: f64,
    },
    /// Adds `codes` in the first `width` of every `period` columns.
    Fence { period: usize, width: usize, codes: f64 },
    /// Adds a disc with a sharp edge: `codes` where the distance to (`row`, `column`) is below `radius`.
    Disc { row: usize, column: usize, radius: f64, codes: f64 },
    /// Adds glare: `codes / (1 + (d / radius)^2)` at the distance d from (`row`, `column`).
    Glare { row: usize, column: usize, radius: f64, codes: f64 },
    /// Adds `codes` at random pixels, about `share` of all, which depend on `seed`.
    Hot { share: f64, codes: f64, seed: u64 },
    /// Blurs by motion: the mean over this (odd) number of pixels of a row, with the edge pixel repeated.
    Motion(usize),
}

fn everywhere() -> [usize; 2] {
    [0, usize::MAX]
}

impl Draw {
    /// The image after this change.
    pub fn apply(&self, image: &Array2<f64>) -> Array2<f64> {
        Array2::from_shape_fn(image.dim(), |place| self.value(image, place))
    }

    /// The value of a pixel after this change of `image`.
    fn value(&self, image: &Array2<f64>, (row, column): (usize, usize)) -> f64 {
        let (value, width) = (image[(row, column)], image.ncols());
        let added = |is_there, codes| value + if is_there { codes } else { 0.0 };
        let distance = |i, j| (row.abs_diff(i) as f64).hypot(column.abs_diff(j) as f64);
        match *self {
            Self::Times(factor) => value * factor,
            Self::Decoded(full_scale) => full_scale * Transfer::Srgb.decode(value / full_scale),
            Self::Slope(codes) => value + codes * column as f64 / width as f64,
            Self::Block { rows, columns, codes } => {
                added((rows[0]..rows[1]).contains(&row) && (columns[0]..columns[1]).contains(&column), codes)
            }
            Self::Fence { period, width, codes } => added(column % period < width, codes),
            Self::Disc { row, column, radius, codes } => added(distance(row, column) < radius, codes),
            Self::Glare { row, column, radius, codes } => {
                value + codes / (1.0 + (distance(row, column) / radius).powi(2))
            }
            Self::Hot { share, codes, seed } => {
                added(fraction(seed, (row * width + column) as u64) < share, codes)
            }
            Self::Motion(length) => {
                let along = (0..length).map(|step| (column + step).saturating_sub(length / 2).min(width - 1));
                along.map(|from| image[(row, from)]).sum::<f64>() / length as f64
            }
        }
    }
}

/// The light of a scene, which gives its image channels.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Light {
    /// One channel.
    Mono,
    /// Three equal channels.
    White,
    /// Three channels that differ slightly, so that they wrap at different pixels.
    #[default]
    Warm,
}

impl Light {
    /// The image in this light.
    pub fn on(self, image: &Array2<f64>) -> Array3<f32> {
        let light: &[f64] = match self {
            Self::Mono => &[1.0],
            Self::White => &[1.0; 3],
            Self::Warm => &[1.0, 0.95, 0.9],
        };
        let (height, width) = image.dim();
        Array3::from_shape_fn((height, width, light.len()), |(row, column, channel)| {
            (image[(row, column)] * light[channel]) as f32
        })
    }
}

/// A change of the red channel alone.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Red {
    /// Adds a lamp of `codes` in a rectangle, from the first number of each pair up to the second.
    Block { rows: [usize; 2], columns: [usize; 2], codes: f32 },
    /// Shifts it by this number of columns to the right, as chromatic aberration does, with the edge pixel repeated.
    Shift(usize),
}

impl Red {
    /// The image after this change.
    pub fn apply(&self, mut image: Array3<f32>) -> Array3<f32> {
        match *self {
            Self::Block { rows, columns, codes } => {
                let mut lamp = image.slice_mut(s![rows[0]..rows[1], columns[0]..columns[1], 0]);
                lamp.mapv_inplace(|value| value + codes);
                image
            }
            Self::Shift(columns) => Array3::from_shape_fn(image.dim(), |(row, column, channel)| {
                let from = if channel == 0 { column.saturating_sub(columns) } else { column };
                image[(row, from, channel)]
            }),
        }
    }
}

/// The rendered driving scene of the preset called `name`, with seed 0 and full scale `alpha` peaks.
pub fn rendered(name: &str, alpha: f64) -> Array3<f32> {
    let full = (256.0 * alpha) as f32;
    let preset = Preset::ALL.into_iter().find(|preset| preset.name() == name);
    let scene = Scene::new(preset.expect("the catalogue has names of presets"), 0);
    scene.render(0, SIZE.0, SIZE.1).radiance.mapv_into(|value| value * full)
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
        let dark = Background::Even(0.0).image(SIZE);
        let draw = |seed| Draw::Hot { share: 0.01, codes: 1.0, seed }.apply(&dark);
        assert_eq!(draw(1), draw(1));
        assert!(draw(1) != draw(2));
        let share = draw(3).mean().expect("the image has pixels");
        assert!((share - 0.01).abs() < 0.002, "{share}");
    }

    #[test]
    fn motion_keeps_what_is_even_and_spreads_a_line() {
        let pole = Draw::Block { rows: everywhere(), columns: [100, 101], codes: 15.0 };
        let line = Draw::Motion(15).apply(&pole.apply(&Background::Even(7.0).image(SIZE)));
        assert_eq!((line[(5, 92)], line[(5, 93)], line[(5, 107)], line[(5, 108)]), (7.0, 8.0, 8.0, 7.0));
    }

    #[test]
    fn red_moves_alone() {
        let image = Red::Shift(3).apply(Light::White.on(&Background::Ramp(1.0).image(SIZE)));
        assert_eq!((image[(0, 0, 0)], image[(0, 50, 0)], image[(0, 50, 1)]), (0.0, 7.0, 10.0));
    }
}
