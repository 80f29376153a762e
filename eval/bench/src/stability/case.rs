//! [`Case`]: one scene of the catalogue, its sensor, and the expected result of each method.

use modulo_core::unwrap::{METHODS, Options, Unwrap, by_name, of_gains};
use modulo_core::{Exposure, Gains, Mosaic, Psf, Sensor, SensorConfig, SensorError};
use ndarray::Array3;
use serde::Serialize;

use super::expect::Expect;

/// Seed of the noise of the sensor, which is the same in all cases.
const SEED: u64 = 3;

/// A section of the catalogue, in the order of the report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    Steps,
    Islands,
    Lamps,
    Poles,
    Horizons,
    Ramps,
    Noise,
    Levels,
    Colour,
    Bits,
    Sizes,
    Alpha,
    Streets,
    Mosaics,
    Gains,
}

impl Family {
    /// Heading and description.
    pub fn title(self) -> (&'static str, &'static str) {
        match self {
            Self::Steps => ("Steps", "Sharp edges from the upper to the lower border."),
            Self::Islands => ("Islands", "Plateaus whose whole contour is steep."),
            Self::Lamps => ("Lamps", "Small objects that are far brighter than the rest."),
            Self::Poles => ("Poles and fences", "Thin bright objects over the full height."),
            Self::Horizons => ("Horizons", "A bright sky: one edge along every row or none."),
            Self::Ramps => ("Ramps", "Even slopes around half a peak a pixel."),
            Self::Noise => ("Noise", "Read noise and hot pixels."),
            Self::Levels => ("Levels", "No difference is steep: only the absolute level is in question."),
            Self::Colour => ("Colour and motion", "Channels that differ, and a long exposure."),
            Self::Bits => ("Bits", "One scene seen by sensors of 1 to 16 bits."),
            Self::Sizes => ("Sizes", "Odd and tiny images, and one without colour."),
            Self::Alpha => ("Saturation factor", "One scene, brighter and brighter."),
            Self::Streets => ("Streets", "The rendered driving scenes, with and without a lens."),
            Self::Mosaics => {
                ("Colour mosaics", "A chip whose pixels see one colour each, in the pattern RGGB.")
            }
            Self::Gains => (
                "Two gains",
                "Every second pixel or row, or red and blue have a lower gain, by which a method of its own unwraps.",
            ),
        }
    }
}

/// The description of a scene, as `results.json` has it.
#[derive(Clone, Debug, Serialize)]
pub struct SceneDescription {
    /// Unique name of lower-case letters, digits and `_`, which also names the pictures.
    pub name: String,
    pub family: Family,
    /// The content of the scene.
    pub what: String,
    /// The reason for the results of the methods.
    pub why: &'static str,
    /// If k is not observable: another scene with the same modulo image.
    pub twin: Option<&'static str>,
    pub bits: u8,
    pub alpha: f64,
}

/// A scene, its sensor, and the expected results.
pub struct Case {
    pub(super) scene: SceneDescription,
    /// The sensor, but for the bits and alpha of the scene.
    sensor: SensorConfig,
    draw: Box<dyn Fn() -> Array3<f32>>,
    all: Expect,
    but: Vec<(&'static [&'static str], Expect)>,
}

impl Case {
    /// A case that every method is expected to recover, with a sensor of 8 bits at alpha 4 without lens blur. `draw` returns
    /// the radiance in codes of an 8-bit sensor.
    pub(super) fn new(
        family: Family,
        name: impl Into<String>,
        what: impl Into<String>,
        draw: impl Fn() -> Array3<f32> + 'static,
    ) -> Self {
        let (name, what) = (name.into(), what.into());
        Self {
            scene: SceneDescription { name, family, what, why: "", twin: None, bits: 8, alpha: 4.0 },
            sensor: SensorConfig::PLAIN,
            draw: Box::new(draw),
            all: Expect::Exact,
            but: Vec::new(),
        }
    }

    /// The unique name.
    pub fn name(&self) -> &str {
        &self.scene.name
    }

    /// The heading of its family.
    pub fn family(&self) -> &'static str {
        self.scene.family.title().0
    }

    /// The content of the scene.
    pub fn what(&self) -> &str {
        &self.scene.what
    }

    /// Whether the modulo image is enough to know k.
    pub fn is_observable(&self) -> bool {
        self.scene.twin.is_none()
    }

    /// Sets the lens of the paper with 7 x 7 taps.
    pub(super) fn lens(mut self) -> Self {
        self.sensor.psf = Psf::Paper7;
        self
    }

    /// Sets a Gaussian lens blur of `sigma` px.
    pub(super) fn gaussian(mut self, sigma: f64) -> Self {
        self.sensor.psf = Psf::Gaussian { sigma };
        self
    }

    /// Sets the colour filters.
    pub(super) fn mosaic(mut self, mosaic: Mosaic) -> Self {
        self.sensor.mosaic = Some(mosaic);
        self
    }

    /// Gives every second pixel the lower gain that goes with the saturation factor that is set by now.
    pub(super) fn two_gains(mut self) -> Self {
        self.sensor.gains = Gains::checkerboard(self.scene.alpha);
        self
    }

    /// Sets the saturation factor.
    pub(super) fn alpha(mut self, alpha: f64) -> Self {
        self.scene.alpha = alpha;
        self
    }

    /// Sets the bits of the sensor. The radiance in units of the peak stays the same.
    pub(super) fn bits(mut self, bits: u8) -> Self {
        self.scene.bits = bits;
        self
    }

    /// Sets the standard deviation of the read noise, codes.
    pub(super) fn read_noise(mut self, sigma: f64) -> Self {
        self.sensor.read_noise = sigma;
        self
    }

    /// Sets the reason for the results.
    pub(super) fn why(mut self, why: &'static str) -> Self {
        self.scene.why = why;
        self
    }

    /// Marks k as not observable, and describes another scene with the same modulo image.
    pub(super) fn unobservable(mut self, twin: &'static str) -> Self {
        self.scene.twin = Some(twin);
        self
    }

    /// Sets the expected result of all methods.
    pub(super) fn all(mut self, expect: Expect) -> Self {
        self.all = expect;
        self
    }

    /// Sets the expected result of `methods` instead of that of all methods. Later calls take precedence.
    pub(super) fn but(mut self, methods: &'static [&'static str], expect: Expect) -> Self {
        self.but.push((methods, expect));
        self
    }

    /// The expected result of `method`.
    pub(super) fn expected(&self, method: &str) -> Expect {
        // The last exception that names the method is the most specific one.
        let own = self.but.iter().rev().find(|(methods, _)| methods.contains(&method));
        own.map_or(self.all, |(_, expect)| *expect)
    }

    /// Returns the methods that can unwrap the images of the sensor.
    pub fn methods(&self) -> Vec<Box<dyn Unwrap>> {
        match of_gains(self.sensor.gains) {
            Some(method) => vec![method],
            None => METHODS
                .iter()
                .map(|name| {
                    by_name(name, &Options::default()).expect("a method of the list with its defaults")
                })
                .collect(),
        }
    }

    /// Draws the scene and exposes the sensor to it.
    ///
    /// # Errors
    /// [`SensorError`] for an impossible sensor or image, which no case of the catalogue has.
    pub fn expose(&self) -> Result<Exposure, SensorError> {
        let SceneDescription { bits, alpha, .. } = self.scene;
        // Scenes are drawn in codes of 8 bits. A sensor of other bits sees the same scene in units of its peak, so that
        // its range is alpha peaks as well.
        let full_scale = (256.0 * alpha) as f32;
        let radiance = (self.draw)().mapv_into(|codes| codes / full_scale);
        Sensor::new(SensorConfig { bits, alpha, ..self.sensor })?.expose(radiance.view(), SEED)
    }
}
