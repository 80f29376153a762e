//! Tells of a sensor whose alpha is too large for its lens.

use modulo_core::Psf;
use modulo_core::unwrap::{fit_up_to, proved_up_to};

use super::parameters::{BlurShape, SensorModel};

impl SensorModel {
    /// Returns the largest alpha up to which such a sensor is fit, which takes some ms: most pictures are proved as a
    /// whole ([`proved_up_to`]) or were found to be right ([`fit_up_to`]). `None` if its lens is unknown.
    pub fn fit_up_to(&self) -> Option<f64> {
        let measured = self.lens().map(|psf| fit_up_to(psf, self.mosaic.is_some(), self.gains))?;
        Some(self.proved_up_to().map_or(measured, |[_, most]| most.max(measured)))
    }

    /// Returns the limits of [`proved_up_to`]; `None` where nothing is proved: without black columns, behind an unknown
    /// or sharp lens, on a mosaic and of two gains.
    pub fn proved_up_to(&self) -> Option<[f64; 2]> {
        let is_black = self.range().is_ok_and(|range| range.black() > 0);
        let is_proved = is_black && !self.gains && self.mosaic.is_none();
        let (psf, noise) = self.lens().zip(self.noise()).filter(|_| is_proved)?;
        proved_up_to(psf, self.bits, noise)
    }

    /// Returns the blur of the lens; `None` where it is not known.
    pub fn lens(&self) -> Option<Psf> {
        (self.psf != BlurShape::Unknown).then(|| self.psf())
    }

    /// Returns what is to be expected of this sensor, if its alpha is too large for it.
    pub fn unfit(&self) -> Option<String> {
        let most = self.fit_up_to().filter(|most| self.alpha > *most)?;
        Some(format!(
            "alpha {} is too large for this sensor, whose counts can be found up to alpha {most} on real pictures; take a smaller \
             alpha, a softer lens (psf_sigma) or other gains, or expect wrong counts",
            self.alpha
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameter::ParameterSet as _;

    fn sensor(pairs: &[(&str, &str)]) -> SensorModel {
        SensorModel::from_text(pairs).expect("possible")
    }

    #[test]
    fn every_kind_of_sensor_is_in_the_table_and_a_softer_lens_is_never_worse() {
        for (mosaic, _) in modulo_core::Mosaic::WORDS {
            for (gains, _) in modulo_core::Gains::WORDS {
                let behind = |lens: f64| {
                    let lens = lens.to_string();
                    sensor(&[("mosaic", mosaic), ("gains", gains), ("psf_sigma", &lens)])
                        .fit_up_to()
                        .expect("a lens")
                };
                let fit = [0.0, 0.3, 0.5, 0.79, 0.8, 1.0, 1.4, 2.0, 8.0].map(behind);
                assert!(fit.is_sorted(), "{mosaic} {gains}: {fit:?}");
            }
        }
    }

    #[test]
    fn a_sensor_with_too_large_an_alpha_says_so() {
        assert_eq!(sensor(&[("alpha", "4"), ("psf_sigma", "1.4")]).unfit(), None);
        assert_eq!(sensor(&[("alpha", "4"), ("psf", "paper7")]).unfit(), None);
        assert_eq!(sensor(&[("alpha", "1")]).unfit(), None, "nothing wraps");
        let raw = sensor(&[("alpha", "4"), ("mosaic", "grbg"), ("psf_sigma", "0")]);
        assert!(raw.unfit().is_some() && raw.of_channels(3).unfit().is_some());
        assert_eq!((raw.of_channels(1).unfit(), raw.of_channels(1).lens()), (None, None));
        let why = sensor(&[("alpha", "4"), ("psf_sigma", "0")]).unfit().expect("a sharp lens");
        assert!(why.contains("alpha 4") && why.contains("gains"), "{why}");
    }
}
