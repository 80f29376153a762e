//! One exposure of a picture and its recovery, as `modulo simulate` makes them.

use modulo_core::unwrap::{Method, OffsetEvidence, Options, Trust, fit_up_to};
use modulo_core::{Exposure, Frame, Psf, Recovered, Sensor, SensorConfig, SensorError, UnwrapError};

use crate::picture::Picture;

/// The full scale of a picture over the end of the range, and the seed of the noise: the defaults of `modulo simulate`.
const HEADROOM: f64 = 0.97;
const SEED: u64 = 0;

/// An exposure, with its recovered image once that was made.
pub struct Capture {
    psf: Psf,
    /// The radiance on the sensor.
    pub exposure: Exposure,
    /// The modulo image.
    pub modulo: Frame,
    /// The recovered image.
    pub recovered: Recovered,
}

/// Why a result is trusted, or why it is not. The page has a sentence for each number.
#[derive(Clone, Copy, PartialEq)]
pub enum Reason {
    NothingWraps = 0,
    RangeShowsLevel = 1,
    ColumnsShowLevel = 2,
    LevelIsUnknown = 3,
    AlphaIsTooLarge = 4,
    CountsContradict = 5,
    EdgesMayHide = 6,
}

impl Capture {
    /// Exposes a sensor to a picture.
    pub fn new(picture: &Picture, config: SensorConfig) -> Result<Self, SensorError> {
        let config = SensorConfig { headroom: HEADROOM, transfer: picture.transfer(), ..config };
        let exposure = Sensor::new(config)?.expose(picture.radiance.view(), SEED)?;
        Ok(Self { psf: config.psf, modulo: exposure.modulo(), exposure, recovered: Recovered::default() })
    }

    /// Finds the wrap counts of the modulo image.
    pub fn recover(&mut self) -> Result<(), UnwrapError> {
        let mut method = Method::Auto.build(&Options::default())?;
        method.unwrap(&self.modulo, &self.exposure.scene(), &mut self.recovered)
    }

    /// Returns the largest alpha up to which this sensor is fit.
    pub fn fit_up_to(&self) -> f64 {
        fit_up_to(self.psf, false, false)
    }

    /// Returns the second differences above the peak, per sample.
    pub fn jumps(&self) -> f64 {
        self.recovered.report.quality.map_or(0.0, |quality| quality.jumps.into())
    }

    /// Returns why the result is trusted, or why it is not.
    pub fn reason(&self) -> Reason {
        let report = &self.recovered.report;
        match report.trust {
            Trust::Trusted if self.exposure.range().alpha() <= 1.0 => Reason::NothingWraps,
            Trust::Trusted if report.offset == Some(OffsetEvidence::OpticalBlack) => Reason::ColumnsShowLevel,
            Trust::Trusted => Reason::RangeShowsLevel,
            Trust::Relative => Reason::LevelIsUnknown,
            _ if self.exposure.range().alpha() > self.fit_up_to() => Reason::AlphaIsTooLarge,
            Trust::Unobservable => Reason::EdgesMayHide,
            Trust::Untrusted | Trust::Unknown => Reason::CountsContradict,
        }
    }
}
