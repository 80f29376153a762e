//! [`Album`]: the pictures of a run, as files beside the page, or none at all.

use std::path::{Path, PathBuf};

use modulo_core::{Exposure, Frame, FrameError, SensorError};
use modulo_images::save_png;
use ndarray::{Array3, s};

use super::picture;
use crate::StudyError;

/// The scene that shows what is peculiar to a method, for the documentation.
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

/// Rows of a scene that a figure shows.
const ROWS: std::ops::Range<usize> = 32..160;

/// Where pictures go.
pub struct Album {
    out: Option<PathBuf>,
}

/// What every picture of a scene is shown beside.
pub struct Sheet<'a> {
    out: &'a Path,
    scene: &'a str,
    limit: f64,
    truth: Array3<u8>,
    modulo: Array3<u8>,
}

impl Album {
    /// Pictures go into `out`, which has folders `pictures` and `figures`.
    pub fn in_folder(out: &Path) -> Self {
        Self { out: Some(out.to_owned()) }
    }

    /// Nothing is drawn.
    pub fn none() -> Self {
        Self { out: None }
    }

    /// Writes truth and modulo image of `scene`.
    ///
    /// # Errors
    /// [`StudyError::Save`].
    pub fn open<'a>(
        &'a self,
        scene: &'a str,
        exposure: &Exposure,
        y: &Frame,
    ) -> Result<Option<Sheet<'a>>, StudyError> {
        let Some(out) = self.out.as_deref() else { return Ok(None) };
        let limit = exposure.range().limit();
        let truth = picture::radiance(&exposure.x().mapv(f32::floor), limit);
        let modulo = picture::codes(y, exposure.range().peak());
        let sheet = Sheet { out, scene, limit, truth, modulo };
        sheet.save(&sheet.path("truth"), &[&sheet.truth])?;
        sheet.save(&sheet.path("modulo"), &[&sheet.modulo])?;
        Ok(Some(sheet))
    }
}

impl Sheet<'_> {
    /// Writes what `method` recovered, unless it looks as the truth does; the path of its picture within the folder.
    ///
    /// # Errors
    /// [`StudyError::Save`].
    pub fn add(&self, method: &str, x: &Array3<f32>) -> Result<String, StudyError> {
        let result = picture::radiance(x, self.limit);
        if FIGURES.contains(&(method, self.scene)) {
            let parts = [&self.truth, &self.modulo, &result]
                .map(|picture| picture.slice(s![ROWS, .., ..]).to_owned());
            self.save(&format!("figures/{method}.png"), &parts.each_ref())?;
        }
        if result == self.truth {
            return Ok(self.path("truth"));
        }
        self.save(&self.path(method), &[&result])?;
        Ok(self.path(method))
    }

    fn path(&self, label: &str) -> String {
        format!("pictures/{}-{label}.png", self.scene)
    }

    fn save(&self, path: &str, pictures: &[&Array3<u8>]) -> Result<(), StudyError> {
        let frame = picture::strip(pictures).map_err(|error: FrameError| SensorError::from(error))?;
        Ok(save_png(&self.out.join(path), &frame)?)
    }
}
