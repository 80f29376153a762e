use std::collections::BTreeMap;

use modulo_core::Psf;
use serde::{Deserialize, Serialize};

use super::BenchmarkRequest;
use super::Measured;
use super::frames::{BenchFrame, SensedFrame};

/// If calls on one frame differ by more than this share of their median, the figure is uncertain.
const MOST_SPREAD: f64 = 0.1;

/// Time and accuracy of one method over all frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BenchmarkRow {
    /// Name of the method, as in [`modulo_core::unwrap::METHODS`] or as another program calls its method.
    pub method: String,
    /// Saturation factor.
    pub alpha: f64,
    /// Blur of the lens, px.
    pub psf_sigma: f64,
    /// Number of threads that the method may use.
    pub threads: usize,
    /// Median wall-clock time of one call over frames and repeats, ms.
    pub ms_p50: f64,
    /// 5th percentile of this time, ms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ms_p5: Option<f64>,
    /// 95th percentile of this time, ms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ms_p95: Option<f64>,
    /// Share of the samples of all frames with the true wrap count, 0 to 1.
    pub exact_k: f64,
    /// `10 log10(255^2 / mse)` of recovered against ideal 8-bit images, with the mse over the samples of all frames.
    /// `None` (`null`) if all images are equal.
    pub psnr_db: Option<f64>,
    /// Number of frames.
    pub frames: usize,
    /// Number of samples of all frames, pixels times channels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<u64>,
}

impl BenchmarkRow {
    /// The row of `measured`.
    pub(super) fn new(
        request: &BenchmarkRequest,
        method: &str,
        threads: usize,
        samples: &[SensedFrame],
        measured: &Measured,
    ) -> Self {
        Self {
            // The name of the request, not that of the method that `auto` selected: that one can differ between frames.
            method: method.to_owned(),
            alpha: samples.first().map_or(0.0, |sample| sample.range.alpha()),
            psf_sigma: request.exposure.sensor.first().psf().sigma(),
            threads,
            ms_p50: measured.ms(0.5),
            ms_p5: Some(measured.ms(0.05)),
            ms_p95: Some(measured.ms(0.95)),
            exact_k: measured.exact_k(),
            psnr_db: measured.psnr_db(),
            frames: samples.len(),
            samples: Some(measured.samples),
        }
    }

    /// A warning if the calls on one frame differ much: the machine was busy, or its clock frequency changed.
    pub(super) fn warning(&self, spread: f64) -> Option<String> {
        (spread > MOST_SPREAD).then(|| {
            format!(
                "{} at alpha {} with {} threads: half of the calls on one frame lie {:.0} % of their median \
                 apart; more repeats or a quieter machine would make the figure surer",
                self.method,
                self.alpha,
                self.threads,
                spread * 100.0
            )
        })
    }
}

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
    pub(super) fn new(request: &BenchmarkRequest, frames: &[BenchFrame]) -> Self {
        let folder = request.frames.as_ref().map(|folder| folder.display().to_string());
        let sensor = request.exposure.sensor.first();
        let psf = match sensor.psf() {
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
            bits: sensor.bits,
            read_noise: sensor.read_noise,
            seed: request.exposure.seed,
            repeats: request.repeats,
        }
    }
}

fn sizes(frames: &[BenchFrame]) -> Vec<Size> {
    // Sorted by size first, so that sizes with the same number of frames have a fixed order.
    let mut counts = BTreeMap::new();
    frames.iter().for_each(|frame| *counts.entry(frame.dim).or_insert(0) += 1);
    let size = |((height, width, channels), frames)| Size { width, height, channels, frames };
    let mut sizes: Vec<Size> = counts.into_iter().map(size).collect();
    sizes.sort_by_key(|size| std::cmp::Reverse(size.frames));
    sizes
}
