//! [`ScenePictures`]: the pictures of a run, as files beside the page.
//!
//! All pictures have the same gamma, which makes dark scenes visible: radiance is `255 sqrt(x / (alpha 2^b))`, codes are
//! `255 y / 2^b`. No figure is computed from pictures.

use std::path::Path;

use modulo_core::{Exposure, Frame, FrameError, SensorError};
use modulo_images::save_png;
use ndarray::{Array3, Axis, concatenate, s};

use crate::BenchError;

/// For each method the scene that shows its peculiarity in the documentation.
const FIGURES: &[(&str, &str)] = &[
    ("auto", "step_200"),
    ("spud", "sun_blur"),
    ("least_squares", "sun_motion"),
    ("itoh", "colour_shift"),
    ("lines", "night_sharp"),
    ("tree", "alpha_8"),
    ("gradient_tree", "pole_1px"),
    ("quality_guided", "horizon_blur"),
];

/// Rows of a scene that a figure of the documentation shows.
const ROWS: std::ops::Range<usize> = 32..160;

/// Width of the white gap between pictures side by side, px.
const GAP: usize = 4;

/// The pictures of one scene.
pub struct ScenePictures<'a> {
    out: &'a Path,
    scene: &'a str,
    limit: f64,
    truth: Array3<u8>,
    modulo: Array3<u8>,
}

impl<'a> ScenePictures<'a> {
    /// Writes the truth and the modulo image of `scene` into `out`, which has the subfolders `pictures` and `figures`.
    pub fn new(out: &'a Path, scene: &'a str, exposure: &Exposure, y: &Frame) -> Result<Self, BenchError> {
        let limit = exposure.range().limit();
        // The sensor delivers whole codes. A perfect result is therefore floor(x), and equals this picture byte for
        // byte.
        let truth = radiance(&exposure.x().mapv(f32::floor), limit);
        let modulo = codes(y, exposure.range().peak());
        let pictures = Self { out, scene, limit, truth, modulo };
        pictures.save(&pictures.path("truth"), &[&pictures.truth])?;
        pictures.save(&pictures.path("modulo"), &[&pictures.modulo])?;
        Ok(pictures)
    }

    /// Writes the result of `method`, unless it equals the truth. Returns the path of its picture within the folder.
    pub fn add(&self, method: &str, x: &Array3<f32>) -> Result<String, BenchError> {
        let result = radiance(x, self.limit);
        if FIGURES.contains(&(method, self.scene)) {
            let parts = [&self.truth, &self.modulo, &result]
                .map(|picture| picture.slice(s![ROWS, .., ..]).to_owned());
            self.save(&format!("figures/{method}.png"), &parts.each_ref())?;
        }
        // Most methods are exact on most scenes. Their pictures would be copies of the truth: the page links that one.
        if result == self.truth {
            return Ok(self.path("truth"));
        }
        self.save(&self.path(method), &[&result])?;
        Ok(self.path(method))
    }

    fn path(&self, label: &str) -> String {
        format!("pictures/{}-{label}.png", self.scene)
    }

    fn save(&self, path: &str, pictures: &[&Array3<u8>]) -> Result<(), BenchError> {
        let frame = strip(pictures).map_err(|error: FrameError| SensorError::from(error))?;
        Ok(save_png(&self.out.join(path), &frame)?)
    }
}

/// Radiance `x` (code units) of a sensor with range `limit`, as 8-bit pixels.
fn radiance(x: &Array3<f32>, limit: f64) -> Array3<u8> {
    let limit = limit as f32;
    x.mapv(|x| (255.0 * (x / limit).max(0.0).sqrt() + 0.5) as u8)
}

/// Codes of a sensor with peak `peak`, as 8-bit pixels.
fn codes(y: &Frame, peak: f32) -> Array3<u8> {
    y.to_f32().mapv(|y| (255.0 * y / peak + 0.5) as u8)
}

/// Joins pictures of equal height and channels side by side.
fn strip(pictures: &[&Array3<u8>]) -> Result<Frame, FrameError> {
    let (height, _, channels) = pictures[0].dim();
    let gap = Array3::from_elem((height, GAP, channels), 255);
    let parts: Vec<_> = pictures.iter().flat_map(|picture| [gap.view(), picture.view()]).skip(1).collect();
    Frame::from_u8(concatenate(Axis(1), &parts).expect("all pictures show rows of the same scene"))
}
