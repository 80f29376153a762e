//! A picture as radiance: a file, or a rendered scene.

use modulo_core::Transfer;
use modulo_images::{Coding, ImageError, White, decode};
use modulo_scene::{Preset, Scene};
use ndarray::{Array3, Axis, s};

/// The transfer function of all pictures.
pub const TRANSFER: Transfer = Transfer::Srgb;

/// The most pixels that are worked on, so that a phone answers soon and has the memory.
const MOST_PIXELS: usize = 1_000_000;

/// The presets of the sample: the first one that there is. Its seed, and its size: rows and columns.
const SAMPLES: [&str; 2] = ["sunset", "glare"];
const SEED: u64 = 3;
const SAMPLE_SIZE: (usize, usize) = (384, 960);

/// A picture as linear radiance.
pub struct Picture {
    /// H x W x C, with full scale 1.
    pub radiance: Array3<f32>,
    /// The side of the squares of pixels of the file, each of which became one pixel.
    pub reduction: usize,
}

/// Reads a file of any format of `modulo simulate`; `name` is its name in errors. A large picture is reduced.
pub fn open(file: &[u8], name: &str) -> Result<Picture, ImageError> {
    let mut white = White::new(Coding { transfer: TRANSFER, ..Coding::default() })?;
    Ok(reduced(white.radiance(&decode(file, name)?, name)?))
}

/// Renders the sample.
pub fn sample() -> Picture {
    let named = |name: &&str| Preset::ALL.into_iter().find(|preset| preset.name() == *name);
    let preset = SAMPLES.iter().find_map(named).unwrap_or(Preset::ALL[0]);
    let (height, width) = SAMPLE_SIZE;
    Picture { radiance: Scene::new(preset, SEED).render(0, height, width).radiance, reduction: 1 }
}

/// Returns the means of the smallest squares with which at most [`MOST_PIXELS`] remain. The rest at the right and at the bottom is cut
/// off.
fn reduced(radiance: Array3<f32>) -> Picture {
    let (height, width, channels) = radiance.dim();
    let fits = |side: &usize| (height / side) * (width / side) <= MOST_PIXELS;
    let reduction = (1..).find(fits).expect("no large square fits into a picture");
    let (rows, columns) = (height / reduction, width / reduction);
    if reduction == 1 || rows == 0 || columns == 0 {
        return Picture { radiance, reduction: 1 };
    }
    let mut means = Array3::zeros((rows, columns, channels));
    for row in 0..rows * reduction {
        let line = radiance.index_axis(Axis(0), row);
        for column in 0..columns * reduction {
            let mut mean = means.slice_mut(s![row / reduction, column / reduction, ..]);
            mean.scaled_add(1.0 / (reduction * reduction) as f32, &line.row(column));
        }
    }
    Picture { radiance: means, reduction }
}
