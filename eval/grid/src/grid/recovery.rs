//! How near a recovered frame is to the truth, from what the sensor really saw.

use modulo_core::metric::{mse, psnr_db, ssim};
use modulo_core::unwrap::Trust;
use modulo_core::{Exposure, Frame};
use modulo_msgs::diagnostic_msgs::DiagnosticArray;

/// One frame's.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Recovery {
    /// Samples whose wrap count is the true one.
    pub exact: u64,
    /// Samples.
    pub samples: u64,
    /// Whether the method vouches for the frame.
    pub trust: Trust,
    /// Against the ideal image of the same lens.
    pub ideal: Likeness,
    /// Against the ideal image without a lens.
    pub sharp: Likeness,
}

/// How alike two 8-bit pictures are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Likeness {
    mse: f64,
    ssim: Option<f64>,
}

/// What `exact_k`, `psnr_db` and `ssim` are.
pub fn definition() -> &'static str {
    "exact_k: share of all samples whose wrap count is the true one, no shift forgiven. PSNR: 10 log10(255^2 / \
     mse) of the 8-bit image that the detector sees, the mse over the samples of all frames. SSIM: mean over \
     frames, 11 x 11 Gaussian window of 1.5 px. Both against the ideal image of the same sensor, lens and \
     noise (psnr_db, ssim), and against that of the same sensor and noise without a lens (psnr_sharp_db, \
     ssim_sharp)."
}

impl Recovery {
    /// `counts`: x_hat in code units; `shown`: the 8-bit image that the detector gets.
    pub fn new(
        counts: &Frame,
        shown: &Frame,
        said: Option<&DiagnosticArray>,
        exposure: &Exposure,
        sharp: &Exposure,
    ) -> Option<Self> {
        let peak = exposure.range().peak();
        let wraps = exposure.wraps();
        let counts = counts.to_f32();
        let exact = counts.iter().zip(&wraps).filter(|(count, wraps)| (*count / peak) as u8 == **wraps);
        Some(Self {
            exact: exact.count() as u64,
            samples: wraps.len() as u64,
            trust: said.map_or(Trust::Unknown, trust),
            ideal: Likeness::of(shown, &exposure.ideal())?,
            sharp: Likeness::of(shown, &sharp.ideal())?,
        })
    }
}

impl Recovery {
    /// Of an image that was not unwrapped, and has no wrap counts.
    pub fn of_merged(shown: &Frame, exposure: &Exposure, sharp: &Exposure) -> Option<Self> {
        let (ideal, sharp) = (Likeness::of(shown, &exposure.ideal())?, Likeness::of(shown, &sharp.ideal())?);
        Some(Self { ideal, sharp, ..Self::default() })
    }
}

/// What the unwrapping node says of the frame.
fn trust(said: &DiagnosticArray) -> Trust {
    let mut values = said.status.iter().flat_map(|status| &status.values);
    match values.find(|value| value.key == "trusted").map(|value| value.value.as_str()) {
        Some("true") => Trust::Trusted,
        Some("false") => Trust::Contradicted,
        _ => Trust::Unknown,
    }
}

impl Likeness {
    fn of(left: &Frame, right: &Frame) -> Option<Self> {
        let (left, right) = (left.as_u8()?, right.as_u8()?);
        Some(Self { mse: mse(left, right).ok()?, ssim: ssim(left, right).ok()? })
    }

    /// (PSNR dB, SSIM) of several, which are of one size each or weigh alike.
    pub fn mean<'a>(all: impl Iterator<Item = &'a Self> + Clone) -> (Option<f64>, Option<f64>) {
        let mean = |figures: &mut dyn Iterator<Item = f64>| {
            let (sum, count) = figures.fold((0.0, 0u32), |(sum, count), figure| (sum + figure, count + 1));
            (count > 0).then(|| sum / f64::from(count))
        };
        let mse = mean(&mut all.clone().map(|one| one.mse));
        (mse.and_then(psnr_db), mean(&mut all.filter_map(|one| one.ssim)))
    }
}
