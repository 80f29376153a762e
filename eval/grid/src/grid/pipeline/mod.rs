//! The steps of a frame before the detector: simulated sensor, then unwrapping or merging, and how close the result is to
//! the exposure of the simulated sensor.

pub mod auto_exposure;
pub mod multi_exposure;
pub mod paper;
mod suite;

use std::sync::Arc;

use modulo_ap::average::mean;
use modulo_core::metric::{LEAST_SIDE, mse, psnr_db, ssim};
use modulo_core::{Exposure, Frame, Gains, Psf, Sensor, SensorConfig, tone};
use modulo_detector::{Detector, DetectorParameters};
use modulo_msgs::std_msgs::Header;
use modulo_runtime::sensor::recovery::Recovery;
use modulo_runtime::{Clock, Node, NodeName, StampedFrame};
use ndarray::Array3;
use serde::Serialize;

use super::Request;
use super::frames::FrameWithNeighbours;
use crate::GridError;
use crate::results::{Point, Protocol, Stream};
use paper::{PaperPipeline, SPUD_AS_PUBLISHED};
use suite::SuitePipeline;

/// (stage, nanoseconds) in the order of the stages.
pub type Stages = Vec<(&'static str, u64)>;

/// The result of a pipeline for one frame.
#[derive(Default)]
pub struct DetectorInput {
    /// The image for the detector. `None` if a step gave no image.
    pub image: Option<Arc<StampedFrame>>,
    /// Duration of each step.
    pub stages: Stages,
    /// Quality of a recovered, merged or saturated image. `None` if nothing is compared.
    pub recovery: Option<RecoveryQuality>,
}

/// Turns the frames of one cell into images for the detector. Each worker has its own.
pub type FramePipeline<'a> =
    Box<dyn FnMut(FrameWithNeighbours) -> Result<DetectorInput, GridError> + Send + 'a>;

/// Makes a detector, as [`detector`] does. A test can replace it.
pub type MakeDetector = dyn Fn(&DetectorParameters) -> Result<Box<dyn Node>, GridError> + Sync;

/// Makes a detector of the suite and warms it up.
///
/// # Errors
/// [`GridError`] for an impossible parameter or a model that does not run.
pub fn detector(with: &DetectorParameters) -> Result<Box<dyn Node>, GridError> {
    Ok(Box::new(Detector::new(with)?))
}

/// The clock, seed and comparison of a pipeline.
#[derive(Clone, Copy)]
pub struct PipelineConfig<'a> {
    /// Measures the stages.
    pub timer: &'a dyn Clock,
    /// Seed of the noise of the first frame.
    pub seed: u64,
    /// Whether the images are compared with the true ones, which takes longer than most methods.
    pub compares: bool,
}

/// Refuses streams that the protocol of the paper does not know, and merged captures of moving scenes where the frames of the data are
/// not consecutive.
pub fn check(request: &Request, points: &[Point]) -> Result<(), GridError> {
    let refuse = |stream: Stream, possible| Err(GridError::value("stream", stream.name(), possible));
    for &Point { stream, .. } in points {
        if request.options.protocol == Protocol::Paper && !Stream::OF_PAPER.contains(&stream) {
            return refuse(stream, "one of the other streams under the protocol of the paper");
        }
        if stream == Stream::MultiExposure && request.data.is_still() {
            let possible = "multi_exposure_still, because these frames are not consecutive; use --sequence or --source otherwise";
            return refuse(stream, possible);
        }
    }
    Ok(())
}

/// The pipeline of the cell at `point`. `compares`: see [`PipelineConfig::compares`].
pub fn open<'a>(
    request: &Request,
    timer: &'a dyn Clock,
    point: &Point,
    compares: bool,
) -> Result<FramePipeline<'a>, GridError> {
    let config = PipelineConfig { timer, seed: request.options.seed, compares };
    if request.options.protocol == Protocol::Paper {
        let mut pipeline = PaperPipeline::new(point, timer)?;
        return Ok(Box::new(move |frame| pipeline.run(&frame.frame)));
    }
    if point.stream.follows_frames() {
        return auto_exposure::pipeline(request, point, config);
    }
    if matches!(point.stream, Stream::MultiExposure | Stream::MultiExposureStill) {
        return multi_exposure::pipeline(point, config);
    }
    if point.method.as_deref() == Some(SPUD_AS_PUBLISHED) {
        return paper::published_spud(point, config);
    }
    let mut pipeline = SuitePipeline::new(point, config)?;
    Ok(Box::new(move |frame| pipeline.run(frame.number, frame.frame)))
}

/// Time stamp of a frame for the nodes, ns: frames follow each other at 10 Hz, as in KITTI.
pub fn stamp(number: usize) -> u64 {
    number as u64 * 100_000_000
}

/// The name of a node in the root namespace. `name` is a valid ROS name.
pub fn node_name(name: &str) -> NodeName {
    NodeName { name: name.to_owned(), namespace: "/".to_owned(), remaps: Vec::new() }
}

/// Runs a step, and adds its duration to `stages`.
fn timed<T>(timer: &dyn Clock, stages: &mut Stages, name: &'static str, step: impl FnOnce() -> T) -> T {
    let start = timer.ticks_ns();
    let done = step();
    stages.push((name, timer.ticks_ns().saturating_sub(start)));
    done
}

fn unstamped(frame: Frame) -> Arc<StampedFrame> {
    Arc::new(StampedFrame { header: Header::default(), frame })
}

/// The true exposures that a recovered image is compared with: through the lens of the cell, and without a lens.
struct Truth([Sensor; 2]);

impl Truth {
    fn of(sensor: SensorConfig) -> Result<Self, GridError> {
        Ok(Self([Sensor::new(sensor)?, Sensor::new(SensorConfig { psf: Psf::None, ..sensor })?]))
    }

    /// The exposures to a scene: its radiance, and the seed of the noise.
    fn expose(&self, (radiance, seed): (&Array3<f32>, u64)) -> Result<[Exposure; 2], GridError> {
        let [blurred, sharp] = &self.0;
        Ok([blurred.expose(radiance.view(), seed)?, sharp.expose(radiance.view(), seed)?])
    }

    /// The input of a detector with an image that has no wrap counts, and with its quality unless nothing is compared.
    fn compared(
        &self,
        config: PipelineConfig<'_>,
        scene: (&Array3<f32>, u64),
        image: Frame,
        stages: Stages,
    ) -> Result<DetectorInput, GridError> {
        let truth = config.compares.then(|| self.expose(scene)).transpose()?;
        let recovery = truth.and_then(|truth| RecoveryQuality::of_merged(&image, &truth));
        Ok(DetectorInput { image: Some(unstamped(image)), stages, recovery })
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RecoveryQuality {
    /// Number of samples with the true wrap count.
    pub exact: u64,
    /// Number of samples; with two gains, of those of full gain.
    pub samples: u64,
    /// Whether the method trusts its result. `None` if it makes no statement.
    pub trusted: Option<bool>,
    /// The method that was used, which `auto` selects. Empty if the node does not tell it.
    pub method_used: String,
    /// Similarity to the ideal image through the same lens.
    pub ideal: ImageSimilarity,
    /// Similarity to the ideal image without a lens.
    pub sharp: ImageSimilarity,
}

/// Similarity of two 8-bit images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ImageSimilarity {
    /// Mean squared difference of the samples.
    pub mse: f64,
    /// SSIM. `None` for an image that is smaller than its window.
    pub ssim: Option<f64>,
}

/// The definition of `exact_k`, `psnr_db` and `ssim` for the report.
pub const RECOVERY_DEFINITION: &str = "\
    exact_k: share of all samples whose wrap count is the true one, no shift forgiven. exact_frames: share of \
    the frames in which all of them are. trusted_wrong: number of frames that the method trusts although less \
    than 99.9 % of their counts are the true ones. PSNR: 10 log10(255^2 / \
    mse) of the 8-bit image that the detector sees, the mse over the samples of all frames, inf for equal images. \
    A saturated image is first brought to the scale of the ideal one, from which alpha separates it. SSIM: mean over \
    frames, 11 x 11 Gaussian window of 1.5 px. Both against the ideal image of the same sensor, lens and \
    noise (psnr_db, ssim), and against that of the same sensor and noise without a lens (psnr_sharp_db, \
    ssim_sharp).";

impl RecoveryQuality {
    /// The quality of an unwrapped image. `counts` is x_hat in code units, `image` the 8-bit image for the detector,
    /// `said` what the node says about the image, and `truth` the exposures with and without the lens. `None` if an image has another size than the truth.
    pub fn of_unwrapped(
        counts: &Frame,
        image: &Frame,
        said: Recovery<'_>,
        truth: &[Exposure; 2],
    ) -> Option<Self> {
        let peak = truth[0].range().peak();
        let (wraps, counts) = (truth[0].wraps(), counts.to_f32());
        let (_, width, channels) = wraps.dim();
        let of_full_gain = |sample: usize| {
            let pixel = sample / channels;
            truth[0].gains() == Gains::One || truth[0].gain(pixel / width, pixel % width) == 1.0
        };
        let (mut exact, mut samples) = (0, 0);
        for (sample, (wraps, count)) in wraps.as_slice()?.iter().zip(counts.as_slice()?).enumerate() {
            if of_full_gain(sample) {
                samples += 1;
                // x_hat = y + k P with y < P, so that the integer part of x_hat / P is k.
                exact += u64::from((count / peak) as u8 == *wraps);
            }
        }
        Some(Self {
            exact,
            samples,
            trusted: said.trusted,
            method_used: said.method_used.to_owned(),
            ..Self::of_merged(image, truth)?
        })
    }

    /// Share of the samples with the true wrap count, 0 to 1. 1 without samples.
    pub fn exact_share(&self) -> f64 {
        if self.samples == 0 { 1.0 } else { self.exact as f64 / self.samples as f64 }
    }

    /// The quality of a saturated image of codes, which has no wrap counts.
    pub fn of_saturated(codes: &Frame, truth: &[Exposure; 2]) -> Option<Self> {
        let range = truth[0].range();
        // With two gains, the codes are those of x / (headroom * alpha).
        let scale = match truth[0].gains() {
            Gains::One => 1.0,
            Gains::Checkerboard { .. } => (range.white() / f64::from(range.peak())) as f32,
        };
        let (transfer, most) = (truth[0].transfer(), range.peak() - 1.0);
        let radiance = |code: f32| most * transfer.decode((code / most).into()) as f32;
        let x = codes.demosaiced().to_f32().mapv(|code| scale * radiance(code));
        Self::of_merged(&tone::picture(&x, range, transfer).ok()?, truth)
    }

    /// The quality of a merged image, which has no wrap counts.
    pub fn of_merged(image: &Frame, truth: &[Exposure; 2]) -> Option<Self> {
        let [lens, none] = truth.each_ref().map(Exposure::ideal);
        let ideal = ImageSimilarity::of(image, &lens.demosaiced())?;
        let sharp = if none == lens { ideal } else { ImageSimilarity::of(image, &none.demosaiced())? };
        Some(Self { ideal, sharp, ..Self::default() })
    }
}

impl ImageSimilarity {
    fn of(left: &Frame, right: &Frame) -> Option<Self> {
        let (left, right) = (left.as_u8()?, right.as_u8()?);
        let mse = mse(left, right).ok()?;
        let (height, width, _) = left.dim();
        // Most recovered images equal the ideal one. SSIM, the most expensive figure, is exactly 1 then.
        let equal = mse == 0.0 && height.min(width) >= LEAST_SIDE;
        Some(Self { mse, ssim: if equal { Some(1.0) } else { ssim(left, right).ok()? } })
    }

    /// Mean (PSNR dB, SSIM) of several images with equal weight. The PSNR of equal images is infinite.
    pub fn mean<'a>(all: impl Iterator<Item = &'a Self> + Clone) -> (Option<f64>, Option<f64>) {
        // The mean is taken over the squared errors, not over PSNR: a single perfect frame has an infinite PSNR.
        let mse = mean(all.clone().map(|one| one.mse));
        (mse.map(|mse| psnr_db(mse).unwrap_or(f64::INFINITY)), mean(all.filter_map(|one| one.ssim)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The shortcut for equal images gives what the windows give.
    #[test]
    fn equal_images_have_an_ssim_of_exactly_1() {
        for (height, width) in [(11, 40), (32, 24), (10, 40)] {
            let noisy = |(i, j, c): (usize, usize, usize)| ((i * 31 + j * 17 + c * 7) * 13 % 251) as u8;
            let pixels = Array3::from_shape_fn((height, width, 3), noisy);
            let frame = Frame::from_u8(pixels.clone()).expect("an image");
            let found = ImageSimilarity::of(&frame, &frame).expect("one shape");
            assert_eq!((found.mse, found.ssim), (0.0, ssim(&pixels, &pixels).expect("one shape")));
        }
    }
}
