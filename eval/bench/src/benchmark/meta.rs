//! [`Meta`]: the frames, the sensor and the machine of a benchmark.

use std::collections::BTreeMap;

use modulo_core::Psf;
use serde::{Deserialize, Serialize};

use super::Request;
use super::frames::BenchFrame;

/// Description of a benchmark.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// Name of the processor.
    pub device: String,
    /// Number of processors that this process may use.
    pub processors: usize,
    /// Version of the program.
    pub version: String,
    /// The folder of frames, or `own scenes`.
    pub source: String,
    /// Sizes of the frames, most frequent first.
    pub sizes: Vec<Size>,
    /// The kernel: `none`, `gaussian` or `paper7`.
    pub psf: String,
    /// Bits of the sensor.
    pub bits: u8,
    /// Standard deviation of the read noise, code units.
    pub read_noise: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Number of timed calls for each frame.
    pub repeats: usize,
}

/// Number of frames of one size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Size {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Number of channels, 1 or 3.
    pub channels: usize,
    /// Number of frames of this size.
    pub frames: usize,
}

impl Meta {
    pub(super) fn new(request: &Request, frames: &[BenchFrame]) -> Self {
        let folder = request.frames.as_ref().map(|folder| folder.display().to_string());
        let psf = match request.sensor.psf() {
            Psf::None => "none",
            Psf::Gaussian { .. } => "gaussian",
            Psf::Paper7 => "paper7",
        };
        Self {
            device: request.device.clone(),
            processors: std::thread::available_parallelism().map_or(1, usize::from),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            source: folder.unwrap_or_else(|| "own scenes".to_owned()),
            sizes: sizes(frames),
            psf: psf.to_owned(),
            bits: request.sensor.bits,
            read_noise: request.sensor.read_noise,
            seed: request.sensor.seed,
            repeats: request.repeats,
        }
    }
}

fn sizes(frames: &[BenchFrame]) -> Vec<Size> {
    let mut counts = BTreeMap::new();
    frames.iter().for_each(|frame| *counts.entry(frame.dim).or_insert(0) += 1);
    let size = |((height, width, channels), frames)| Size { width, height, channels, frames };
    let mut sizes: Vec<Size> = counts.into_iter().map(size).collect();
    sizes.sort_by_key(|size| std::cmp::Reverse(size.frames));
    sizes
}
