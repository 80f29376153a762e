//! The frames of a benchmark: a folder of images, or the own scenes.

use std::fs;
use std::path::{Path, PathBuf};

use modulo_core::scene::{Preset, Scene};
use modulo_core::{Exposure, Frame, Range, Sensor};
use modulo_images::{EXTENSIONS, White, read_image};
use ndarray::Array3;

use super::Request;
use crate::{Event, Skipped, StudyError, shown};

/// Size of the own scenes, px: that of most of KITTI's frames.
const WIDTH: usize = 1242;
const HEIGHT: usize = 375;
/// Frames of each own scene: two traffic situations.
const MOMENTS: [u32; 2] = [0, 90];

/// Where a frame is.
pub enum Place {
    /// An image file.
    File(PathBuf),
    /// A frame of an own scene.
    Scene(Scene, u32),
}

/// A frame that can be used, and its (height, width, channels).
pub struct Found {
    place: Place,
    pub dim: (usize, usize, usize),
}

/// What a sensor saw, and the truth.
pub struct Sample {
    pub modulo: Frame,
    pub ideal: Array3<u8>,
    pub wraps: Array3<u8>,
    pub range: Range,
}

/// Frames that can be read, with those that cannot.
pub fn usable(
    request: &Request,
    tell: &mut dyn FnMut(Event<'_>),
) -> Result<(Vec<Found>, Vec<Skipped>), StudyError> {
    let places = match &request.frames {
        None => own(),
        Some(folder) => list(folder)?.into_iter().map(Place::File).collect(),
    };
    let (mut found, mut skipped) = (Vec::new(), Vec::new());
    for place in places {
        match place.radiance() {
            Ok(radiance) => found.push(Found { dim: radiance.dim(), place }),
            Err(why) => {
                let left_out = Skipped { file: place.to_string(), why: why.to_string() };
                tell(Event::Skipped(&left_out));
                skipped.push(left_out);
            }
        }
    }
    match (&request.frames, found.is_empty()) {
        (Some(folder), true) => Err(StudyError::NoFrames(folder.clone())),
        _ => Ok((found, skipped)),
    }
}

/// Exposes all frames; what is kept is bytes, never the radiance.
pub fn sense(frames: &[Found], sensor: &Sensor, seed: u64) -> Result<Vec<Sample>, StudyError> {
    let sample = |frame: &Found| {
        let exposure = sensor.expose(frame.place.radiance()?.view(), seed)?;
        Ok(Sample::of(&exposure))
    };
    frames.iter().map(sample).collect()
}

impl Sample {
    fn of(exposure: &Exposure) -> Self {
        let (modulo, ideal, wraps) = (exposure.modulo(), shown(exposure.ideal()), exposure.wraps());
        Self { modulo, ideal, wraps, range: exposure.range() }
    }
}

impl Place {
    /// In `[0, 1)`; a float image reaches the peak with its own brightest value.
    fn radiance(&self) -> Result<Array3<f32>, StudyError> {
        match self {
            Self::File(path) => Ok(White::new(0.0)?.radiance(&read_image(path)?)),
            Self::Scene(scene, frame) => Ok(scene.render(*frame, HEIGHT, WIDTH).radiance),
        }
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::File(path) => write!(f, "{}", path.display()),
            Self::Scene(scene, frame) => write!(f, "scene://{} frame {frame}", scene.preset().name()),
        }
    }
}

fn own() -> Vec<Place> {
    let moments = |preset| MOMENTS.map(|frame| Place::Scene(Scene::new(preset, 0), frame));
    Preset::ALL.into_iter().flat_map(moments).collect()
}

/// The image files of `folder`, by name.
fn list(folder: &Path) -> Result<Vec<PathBuf>, StudyError> {
    let io = |source| StudyError::Io(folder.to_owned(), source);
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        if path.is_file() && extension.is_some_and(|e| EXTENSIONS.contains(&e.as_str())) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}
