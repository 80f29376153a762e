//! [`RecoveryQuality`]: how close a recovered frame is to the exposure of the simulated sensor.

use modulo_core::metric::{mse, psnr_db, ssim};
use modulo_core::unwrap::Trust;
use modulo_core::{Exposure, Frame};
use modulo_msgs::diagnostic_msgs::DiagnosticArray;

/// The quality of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RecoveryQuality {
    /// Number of samples with the true wrap count.
    pub exact: u64,
    /// Number of samples.
    pub samples: u64,
    /// Whether the method trusts its result.
    pub trust: Trust,
    /// Similarity to the ideal image through the same lens.
    pub ideal: ImageSimilarity,
    /// Similarity to the ideal image without a lens.
    pub sharp: ImageSimilarity,
}

/// Similarity of two 8-bit images.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImageSimilarity {
    mse: f64,
    ssim: Option<f64>,
}

/// The definition of `exact_k`, `psnr_db` and `ssim` for the report.
pub const DEFINITION: &str = "\
    exact_k: share of all samples whose wrap count is the true one, no shift forgiven. PSNR: 10 log10(255^2 / \
    mse) of the 8-bit image that the detector sees, the mse over the samples of all frames. SSIM: mean over \
    frames, 11 x 11 Gaussian window of 1.5 px. Both against the ideal image of the same sensor, lens and \
    noise (psnr_db, ssim), and against that of the same sensor and noise without a lens (psnr_sharp_db, \
    ssim_sharp).";

impl RecoveryQuality {
    /// The quality of an unwrapped image. `counts` is x_hat in code units, `image` the 8-bit image for the detector,
    /// `truth` the exposures with and without the lens. `None` if an image has another size than the truth.
    pub fn of_unwrapped(
        counts: &Frame,
        image: &Frame,
        diagnostics: Option<&DiagnosticArray>,
        truth: &[Exposure; 2],
    ) -> Option<Self> {
        let peak = truth[0].range().peak();
        let wraps = truth[0].wraps();
        let counts = counts.to_f32();
        let exact = counts.iter().zip(&wraps).filter(|(count, wraps)| (*count / peak) as u8 == **wraps);
        Some(Self {
            exact: exact.count() as u64,
            samples: wraps.len() as u64,
            trust: diagnostics.map_or(Trust::Unknown, trust),
            ..Self::of_merged(image, truth)?
        })
    }

    /// The quality of a merged image, which has no wrap counts.
    pub fn of_merged(image: &Frame, truth: &[Exposure; 2]) -> Option<Self> {
        let [ideal, sharp] = truth.each_ref().map(|truth| ImageSimilarity::of(image, &truth.ideal()));
        Some(Self { ideal: ideal?, sharp: sharp?, ..Self::default() })
    }
}

/// Reads from the diagnostics of the unwrapping node whether it trusts the frame.
fn trust(diagnostics: &DiagnosticArray) -> Trust {
    let mut values = diagnostics.status.iter().flat_map(|status| &status.values);
    match values.find(|value| value.key == "trusted").map(|value| value.value.as_str()) {
        Some("true") => Trust::Trusted,
        Some("false") => Trust::Contradicted,
        _ => Trust::Unknown,
    }
}

impl ImageSimilarity {
    fn of(left: &Frame, right: &Frame) -> Option<Self> {
        let (left, right) = (left.as_u8()?, right.as_u8()?);
        Some(Self { mse: mse(left, right).ok()?, ssim: ssim(left, right).ok()? })
    }

    /// Mean (PSNR dB, SSIM) of several images with equal weight.
    pub fn mean<'a>(all: impl Iterator<Item = &'a Self> + Clone) -> (Option<f64>, Option<f64>) {
        let mean = |figures: &mut dyn Iterator<Item = f64>| {
            let (sum, count) = figures.fold((0.0, 0u32), |(sum, count), figure| (sum + figure, count + 1));
            (count > 0).then(|| sum / f64::from(count))
        };
        let mse = mean(&mut all.clone().map(|one| one.mse));
        (mse.and_then(psnr_db), mean(&mut all.filter_map(|one| one.ssim)))
    }
}
