//! A picture as radiance: a file, or a rendered scene.

use modulo_core::Transfer;
use modulo_images::{Coding, ImageError, White, decode};
use modulo_scene::{Preset, Scene, SceneObject};
use ndarray::{Array3, Axis, s};

/// The most pixels that are worked on, so that a phone answers soon and has the memory.
const MOST_PIXELS: usize = 1_000_000;

/// The seed of the scenes, and their size: rows and columns, multiples of 32 for the detector. Those of `modulo demo`.
const SEED: u64 = 1;
const SCENE_SIZE: (usize, usize) = (288, 960);

/// The meaning of the samples of a picture: codes, or radiance.
pub enum Origin {
    /// The radiance of a rendered scene, with its objects.
    Rendered(Vec<SceneObject>),
    /// The radiance of a file with floats.
    Radiance,
    /// The codes of an ordinary picture, by sRGB.
    Codes,
}

/// A picture as linear radiance.
pub struct Picture {
    /// H x W x C, with full scale 1.
    pub radiance: Array3<f32>,
    pub origin: Origin,
    /// The side of the squares of pixels of the file, each of which became one pixel.
    pub reduction: usize,
}

impl Picture {
    /// Reads a file of any format of `modulo simulate`; `name` is its name in errors. A large picture is reduced.
    pub fn open(file: &[u8], name: &str) -> Result<Self, ImageError> {
        let mut white = White::new(Coding { transfer: Transfer::Srgb, ..Coding::default() })?;
        let image = decode(file, name)?;
        let origin = if image.depth() == 32 { Origin::Radiance } else { Origin::Codes };
        let (radiance, reduction) = reduced(white.radiance(&image, name)?);
        Ok(Self { radiance, origin, reduction })
    }

    /// Renders the scene of the preset with this number.
    pub fn render(preset: usize) -> Self {
        let preset = Preset::ALL.get(preset).copied().unwrap_or(Preset::Glare);
        let scene = Scene::new(preset, SEED).render(0, SCENE_SIZE.0, SCENE_SIZE.1);
        Self { radiance: scene.radiance, origin: Origin::Rendered(scene.objects), reduction: 1 }
    }

    /// Returns how its images show radiance. The embedded detector has learnt from scenes that show it linearly.
    pub fn transfer(&self) -> Transfer {
        if matches!(self.origin, Origin::Rendered(_)) { Transfer::Linear } else { Transfer::Srgb }
    }
}

/// Returns the means of the smallest squares with which at most [`MOST_PIXELS`] remain, and their side. The rest at the right and at the
/// bottom is cut off.
fn reduced(radiance: Array3<f32>) -> (Array3<f32>, usize) {
    let (height, width, channels) = radiance.dim();
    let fits = |side: &usize| (height / side) * (width / side) <= MOST_PIXELS;
    let reduction = (1..).find(fits).expect("no large square fits into a picture");
    let (rows, columns) = (height / reduction, width / reduction);
    if reduction == 1 || rows == 0 || columns == 0 {
        return (radiance, 1);
    }
    let mut means = Array3::zeros((rows, columns, channels));
    for row in 0..rows * reduction {
        let line = radiance.index_axis(Axis(0), row);
        for column in 0..columns * reduction {
            let mut mean = means.slice_mut(s![row / reduction, column / reduction, ..]);
            mean.scaled_add(1.0 / (reduction * reduction) as f32, &line.row(column));
        }
    }
    (means, reduction)
}
