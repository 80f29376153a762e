//! The frames of a benchmark: a folder of images, or the procedural scenes.

use std::path::PathBuf;

use modulo_core::{Exposure, Frame, Range, Sensor, Transfer};
use modulo_images::{White, read_image};
use modulo_scene::{Preset, Scene};
use ndarray::Array3;

use super::BenchmarkRequest;
use crate::{BenchError, BenchEvent, Skipped, images, samples8};

/// Size of the procedural scenes, px: that of most frames of KITTI.
const WIDTH: usize = 1242;
const HEIGHT: usize = 375;
/// Frames of each procedural scene: two traffic situations.
const MOMENTS: [u32; 2] = [0, 90];

/// The origin of a frame.
pub enum FrameSource {
    /// An image file with its white point, as in [`crate::ExposureOptions`], and its transfer function.
    File(PathBuf, f32, Transfer),
    /// A frame of a procedural scene.
    Scene(Scene, u32),
}

/// A readable frame with its (height, width, channels).
pub struct BenchFrame {
    source: FrameSource,
    pub dim: (usize, usize, usize),
}

/// The output of the sensor for one frame, and the truth.
pub struct SensedFrame {
    pub modulo: Frame,
    pub ideal: Array3<u8>,
    pub wraps: Array3<u8>,
    pub range: Range,
    pub transfer: Transfer,
}

/// Finds the readable frames, and lists the others.
pub fn usable(
    request: &BenchmarkRequest,
    tell: &mut dyn FnMut(BenchEvent<'_>),
) -> Result<(Vec<BenchFrame>, Vec<Skipped>), BenchError> {
    let sources = match &request.frames {
        None => procedural(),
        Some(folder) => {
            let (white, transfer) = (request.exposure.white, request.exposure.sensor.first().transfer);
            images(folder, tell)?.into_iter().map(|file| FrameSource::File(file, white, transfer)).collect()
        }
    };
    let (mut found, mut skipped) = (Vec::new(), Vec::new());
    for source in sources {
        // The frame is decoded here only to know that it can be read, and its size. Keeping the radiance of a whole
        // folder would need twelve bytes a pixel.
        match source.radiance() {
            Ok(radiance) => found.push(BenchFrame { dim: radiance.dim(), source }),
            Err(why) => {
                let left_out = Skipped { file: source.to_string(), why: why.to_string() };
                tell(BenchEvent::Skipped(&left_out));
                skipped.push(left_out);
            }
        }
    }
    // Frames that cannot be read are skipped, so that one damaged file does not end a run of hours. A folder without
    // any readable frame is a wrong request.
    match (&request.frames, found.is_empty()) {
        (Some(folder), true) => Err(BenchError::NoFrames(folder.clone())),
        _ => Ok((found, skipped)),
    }
}

/// Exposes all frames. Only 8- or 16-bit images are kept, not the radiance.
pub fn sense(frames: &[BenchFrame], sensor: &Sensor, seed: u64) -> Result<Vec<SensedFrame>, BenchError> {
    let sample = |frame: &BenchFrame| {
        let exposure = sensor.expose(frame.source.radiance()?.view(), seed)?;
        Ok(SensedFrame::of(&exposure))
    };
    frames.iter().map(sample).collect()
}

impl SensedFrame {
    fn of(exposure: &Exposure) -> Self {
        let (modulo, ideal, wraps) = (exposure.modulo(), samples8(exposure.ideal()), exposure.wraps());
        Self { modulo, ideal, wraps, range: exposure.range(), transfer: exposure.transfer() }
    }
}

impl FrameSource {
    /// Radiance in `[0, 1)`.
    fn radiance(&self) -> Result<Array3<f32>, BenchError> {
        match self {
            Self::File(path, white, transfer) => {
                Ok(White::new(*white, *transfer)?.radiance(&read_image(path)?, path.display())?)
            }
            Self::Scene(scene, frame) => Ok(scene.render(*frame, HEIGHT, WIDTH).radiance),
        }
    }
}

impl std::fmt::Display for FrameSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::File(path, ..) => write!(f, "{}", path.display()),
            Self::Scene(scene, frame) => write!(f, "scene://{} frame {frame}", scene.preset().name()),
        }
    }
}

fn procedural() -> Vec<FrameSource> {
    let moments = |preset| MOMENTS.map(|frame| FrameSource::Scene(Scene::new(preset, 0), frame));
    Preset::ALL.into_iter().flat_map(moments).collect()
}
