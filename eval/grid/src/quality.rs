//! How close the image that a detector gets is to the true exposure of the simulated sensor.

use modulo_ap::average::mean;
use modulo_core::metric::{LEAST_SIDE, mse, psnr_db, ssim};
use modulo_core::{Exposure, Frame, Gains, Psf, Sensor, SensorConfig, tone};
use modulo_runtime::SensorModel;
use modulo_runtime::lockstep::OnTopic;
use modulo_runtime::sensor::recovery::Recovery;
use ndarray::{Array3, ArrayView2, Axis};
use serde::{Deserialize, Serialize};

use crate::GridError;
use crate::frames::HandedFrame;
use crate::messages::{image, recovery};
use crate::plan::{CAMERA, Cell};

/// How close an image for a detector is to the true one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
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
        // x_hat = y + k P with y < P, so that the integer part of x_hat / P is k.
        let (peak, counts) = (truth[0].range().peak(), counts.to_f32());
        let (exact, samples) = truth[0].exact_counts(&counts.mapv(|count| (count / peak) as u8))?;
        Some(Self {
            exact,
            samples,
            trusted: said.trusted,
            method_used: said.method_used.to_owned(),
            ..Self::of_picture(image, truth)?
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
        Self::of_picture(&tone::picture(&x, range, transfer).ok()?, truth)
    }

    /// The quality of an image without wrap counts.
    pub fn of_picture(image: &Frame, truth: &[Exposure; 2]) -> Option<Self> {
        let [lens, none] = truth.each_ref().map(Exposure::ideal);
        let ideal = ImageSimilarity::of(image, &lens.demosaiced())?;
        let sharp = if none == lens { ideal } else { ImageSimilarity::of(image, &none.demosaiced())? };
        Some(Self { ideal, sharp, ..Self::default() })
    }
}

/// Returns the share of the samples that have the most frequent error of their channel in the wrap counts `k`, which have the shape of the
/// exposure.
pub fn up_to_offset(truth: &Exposure, k: &Array3<u8>) -> f64 {
    let off = k.mapv(i16::from) - truth.wraps().mapv(i16::from);
    let most_frequent = |off: ArrayView2<'_, i16>| {
        // Wrap counts are bytes, so that their differences lie between -255 and 255: 511 values.
        let mut counts = [0usize; 511];
        off.iter().for_each(|off| counts[usize::from(off.abs_diff(-255))] += 1);
        counts.into_iter().max().expect("there are counts")
    };
    off.axis_iter(Axis(2)).map(most_frequent).sum::<usize>() as f64 / off.len() as f64
}

impl ImageSimilarity {
    /// The similarity of two images; `None` if they have no common shape, or not 8 bits.
    pub(crate) fn of(left: &Frame, right: &Frame) -> Option<Self> {
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

/// The true exposures of a frame that its images are compared with: the sensor, the place of the frame, and the exposures through the lens
/// of the sensor and without a lens.
#[derive(Default)]
pub struct TrueExposures(Option<(SensorModel, usize, [Exposure; 2])>);

impl TrueExposures {
    /// Returns how close the image of a cell is to the true exposure of `sensor` to a frame. `None` if nothing is compared.
    pub fn quality(
        &mut self,
        cell: &Cell<'_>,
        out: &[OnTopic],
        (frame, sensor, seed): (&HandedFrame, &SensorModel, u64),
    ) -> Result<Option<RecoveryQuality>, GridError> {
        let is_published = cell.camera().executable != CAMERA;
        let is_saturated = !is_published && cell.stream.images.ends_with("/saturated");
        let (shown, unwrapped) = (image(out, &cell.stream.images), &cell.stream.unwrapped);
        let is_compared = unwrapped.is_some() || is_saturated || is_published;
        let Some(shown) = shown.filter(|_| is_compared) else { return Ok(None) };
        let truth = self.of(frame, sensor, seed)?;
        Ok(match unwrapped {
            None if is_saturated => RecoveryQuality::of_saturated(&shown.frame, truth),
            None => RecoveryQuality::of_picture(&shown.frame, truth),
            Some(topics) => {
                // A detector that leaves the recovered image has no other one to be compared.
                let (picture, counts) = (image(out, &topics.picture), image(out, &topics.counts));
                let said = recovery(out, &topics.recovery);
                picture.zip(counts).zip(said).and_then(|((picture, counts), said)| {
                    RecoveryQuality::of_unwrapped(&counts.frame, &picture.frame, said, truth)
                })
            }
        })
    }

    fn of(
        &mut self,
        frame: &HandedFrame,
        sensor: &SensorModel,
        seed: u64,
    ) -> Result<&[Exposure; 2], GridError> {
        let is_at_hand = |(own, place, _): &(SensorModel, usize, _)| own == sensor && *place == frame.place;
        if !self.0.as_ref().is_some_and(is_at_hand) {
            let (config, seed) = (sensor.config()?, seed.wrapping_add(frame.place as u64));
            let radiance = frame.frame.radiance_for(sensor)?;
            let expose = |config| Sensor::new(config)?.expose(radiance.view(), seed);
            let truth = [expose(config)?, expose(SensorConfig { psf: Psf::None, ..config })?];
            self.0 = Some((sensor.clone(), frame.place, truth));
        }
        Ok(&self.0.as_ref().expect("it was made").2)
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
