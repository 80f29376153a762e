//! [`DisplayCurve`]: shows radiance far above the peak of a sensor on an ordinary screen. It is only for people: no detector and no
//! measure sees it.

use crate::transfer::Transfer;

/// Rolling off and the glare of a lens make pictures flat. This is about the contrast of a print on paper.
const CONTRAST: f64 = 1.8;

/// The extended curve of Reinhard et al. (2002, eq. 4), a contrast of 1.8, and the transfer function of sRGB. With the radiance `r`, in
/// peaks of the sensor:
///
/// ```text
/// t = r (1 + r / white^2) / (1 + r)    for white > 1, else t = r
/// shown = srgb(t^1.8)
/// ```
///
/// `white` is shown as white, and dark regions are displayed alike for every `white`: a saturated image and the recovered image
/// beside it have the same exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplayCurve {
    white: f64,
}

impl DisplayCurve {
    /// The curve of images whose brightest radiance is `white`, in peaks of the sensor (more than 0).
    pub fn of_white(white: f64) -> Self {
        Self { white }
    }

    /// Returns the code, in [0, 1], of a radiance in peaks of the sensor. NaN becomes 0.
    pub fn code(self, radiance: f64) -> f64 {
        let (light, white) = (radiance.max(0.0), self.white);
        let rolled = light * (1.0 + light / (white * white)) / (1.0 + light);
        Transfer::Srgb.encode(if white > 1.0 { rolled } else { light }.powf(CONTRAST))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_is_white_and_dark_parts_of_all_images_look_alike() {
        for white in [0.5, 1.0, 3.88, 256.0] {
            let curve = DisplayCurve::of_white(white);
            assert!(curve.code(white.max(1.0) * 1.0001) > 1.0 - 1e-9, "{white}");
            assert_eq!((curve.code(f64::NAN), curve.code(-1.0), curve.code(0.0)), (0.0, 0.0, 0.0));
            let codes: Vec<f64> = (0..1000).map(|step| curve.code(white * f64::from(step) / 999.0)).collect();
            assert!(codes.is_sorted(), "{white}");
            let other = DisplayCurve::of_white(1.0).code(0.01);
            assert!((curve.code(0.01) / other - 1.0).abs() < 0.02, "{white}");
        }
    }
}
