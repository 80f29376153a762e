//! [`Case`]: one scene of the catalogue, the sensor that sees it, and what is expected of each method.

use modulo_core::{Exposure, Psf, Sensor, SensorConfig, SensorError};
use ndarray::Array3;
use serde::Serialize;

use super::expect::{Evidence, Expect};

/// Seed of the sensor's noise, the same in all cases.
const SEED: u64 = 3;

/// What cases have in common, in the order of the report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// Sharp edges from border to border.
    Steps,
    /// Closed plateaus.
    Islands,
    /// Small very bright things.
    Lamps,
    /// Thin vertical things.
    Poles,
    /// An edge along most of every column.
    Horizons,
    /// Even slopes around half a peak a pixel.
    Ramps,
    /// Sensor noise and defects.
    Noise,
    /// Scenes whose absolute level is the question.
    Levels,
    /// Channels that differ.
    Colour,
    /// One scene, b = 1 to 16.
    Bits,
    /// Images of odd and tiny sizes.
    Sizes,
    /// One scene, growing alpha.
    Alpha,
    /// Rendered driving scenes.
    Streets,
}

impl Family {
    /// Heading and one sentence.
    pub fn title(self) -> (&'static str, &'static str) {
        match self {
            Self::Steps => ("Steps", "Sharp edges from the upper to the lower border."),
            Self::Islands => ("Islands", "Plateaus whose whole contour is steep."),
            Self::Lamps => ("Lamps", "Small things far brighter than the rest."),
            Self::Poles => ("Poles and fences", "Thin bright things over the full height."),
            Self::Horizons => ("Horizons", "A bright sky: one edge along every row or none."),
            Self::Ramps => ("Ramps", "Even slopes around half a peak a pixel."),
            Self::Noise => ("Noise", "Read noise and hot pixels."),
            Self::Levels => ("Levels", "Nothing steep anywhere: the question is the absolute level."),
            Self::Colour => ("Colour and motion", "Channels that differ, and a long exposure."),
            Self::Bits => ("Bits", "One scene seen by sensors of 1 to 16 bits."),
            Self::Sizes => ("Sizes", "Odd and tiny images, and one without colour."),
            Self::Alpha => ("Saturation factor", "One scene, brighter and brighter."),
            Self::Streets => ("Streets", "The rendered driving scenes, with and without a lens."),
        }
    }
}

/// A scene, its sensor, and what is expected.
pub struct Case {
    /// Unique; lower case, digits and `_`; names its pictures.
    pub name: String,
    /// What it belongs to.
    pub family: Family,
    /// What the scene is.
    pub what: String,
    /// Why the methods do what they do on it.
    pub why: &'static str,
    /// Whether k can be known at all.
    pub evidence: Evidence,
    sensor: SensorConfig,
    draw: Box<dyn Fn() -> Array3<f32>>,
    all: Expect,
    but: Vec<(&'static [&'static str], Expect)>,
}

impl Case {
    /// A case that every method is expected to recover, seen by 8 bits at alpha 4 through no lens;
    /// `draw` gives radiance in codes of an 8-bit sensor.
    pub fn new(
        family: Family,
        name: impl Into<String>,
        what: impl Into<String>,
        draw: impl Fn() -> Array3<f32> + 'static,
    ) -> Self {
        Self {
            name: name.into(),
            family,
            what: what.into(),
            why: "",
            evidence: Evidence::Present,
            sensor: SensorConfig { bits: 8, alpha: 4.0, psf: Psf::None, read_noise: 0.0, shot_noise: 0.0 },
            draw: Box::new(draw),
            all: Expect::Exact,
            but: Vec::new(),
        }
    }

    /// Seen through the paper's lens of 7 x 7 taps.
    pub fn lens(mut self) -> Self {
        self.sensor.psf = Psf::Paper7;
        self
    }

    /// Seen through a Gaussian lens of `sigma` pixels.
    pub fn gaussian(mut self, sigma: f64) -> Self {
        self.sensor.psf = Psf::Gaussian { sigma };
        self
    }

    /// Seen with this range.
    pub fn alpha(mut self, alpha: f64) -> Self {
        self.sensor.alpha = alpha;
        self
    }

    /// Seen by `bits` bits; radiance stays what it is in units of the peak.
    pub fn bits(mut self, bits: u8) -> Self {
        self.sensor.bits = bits;
        self
    }

    /// Seen with read noise of `sigma` codes.
    pub fn read_noise(mut self, sigma: f64) -> Self {
        self.sensor.read_noise = sigma;
        self
    }

    /// Says why.
    pub fn why(mut self, why: &'static str) -> Self {
        self.why = why;
        self
    }

    /// Lists the case among those that no method can know, with the scene that y shows as well.
    pub fn unobservable(mut self, twin: &'static str) -> Self {
        self.evidence = Evidence::Absent(twin);
        self
    }

    /// Expects this of all methods.
    pub fn all(mut self, expect: Expect) -> Self {
        self.all = expect;
        self
    }

    /// Expects this of `methods`, whatever is expected of all; a later word counts more.
    pub fn but(mut self, methods: &'static [&'static str], expect: Expect) -> Self {
        self.but.push((methods, expect));
        self
    }

    /// What is expected of `method`.
    pub fn expected(&self, method: &str) -> Expect {
        let own = self.but.iter().rev().find(|(methods, _)| methods.contains(&method));
        own.map_or(self.all, |(_, expect)| *expect)
    }

    /// The sensor.
    pub fn sensor(&self) -> SensorConfig {
        self.sensor
    }

    /// Draws the scene and exposes the sensor to it.
    ///
    /// # Errors
    /// [`SensorError`] when there is no such sensor or image; no case of the catalogue has it.
    pub fn expose(&self) -> Result<Exposure, SensorError> {
        let full_scale = (256.0 * self.sensor.alpha) as f32;
        let radiance = (self.draw)().mapv_into(|codes| codes / full_scale);
        Sensor::new(self.sensor)?.expose(radiance.view(), SEED)
    }
}
