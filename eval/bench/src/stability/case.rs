//! [`Case`]: one scene of the catalogue, its sensor, and the expected result of each method.
//!
//! `scenes.json` is the catalogue: scenes that are hard for some methods.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use modulo_core::unwrap::{METHODS, Options, Unwrap, by_name, of_gains};
use modulo_core::{Exposure, Gains, Mosaic, Psf, Sensor, SensorConfig, SensorError};
use serde::{Deserialize, Serialize};

use super::expect::Expect;
use super::radiance::{Background, Draw, Light, Red, SIZE, rendered};

/// Seed of the noise of the sensor, which is the same in all cases.
const SEED: u64 = 3;

/// The catalogue in the order of the report.
pub static FAMILIES: LazyLock<Vec<Family>> = LazyLock::new(|| {
    let mut families: Vec<Family> =
        serde_json::from_str(include_str!("scenes.json")).expect("the tests read this file");
    for family in &mut families {
        family.scenes.iter_mut().for_each(|case| case.family.clone_from(&family.name));
    }
    families
});

/// A section of the catalogue.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Family {
    /// The name in results.
    pub name: String,
    /// The heading.
    pub title: String,
    /// The description below the heading.
    pub about: String,
    scenes: Vec<Case>,
}

/// Returns all cases, in the order of their families.
pub fn cases() -> Vec<&'static Case> {
    FAMILIES.iter().flat_map(|family| &family.scenes).collect()
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Lens {
    #[default]
    Perfect,
    /// The lens of the paper with 7 x 7 taps.
    Paper7,
    /// A Gaussian with this sigma in px.
    Gaussian(f64),
}

/// A scene, its sensor, and the expected results. In results, it is its description.
#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Case {
    /// Unique name of lower-case letters, digits and `_`, which also names the pictures.
    pub name: String,
    /// [`Family::name`] of its family.
    #[serde(skip_deserializing)]
    family: String,
    /// The content of the scene.
    pub what: String,
    /// The reason for the results of the methods.
    pub(super) why: String,
    /// If k is not observable: another scene with the same modulo image.
    pub(super) twin: Option<String>,
    /// Bits of the sensor, which sees the same scene in units of its peak.
    pub(super) bits: u8,
    /// Saturation factor.
    pub(super) alpha: f64,
    #[serde(skip_serializing)]
    read_noise: f64,
    #[serde(skip_serializing)]
    lens: Lens,
    /// Whether the chip has colour filters in the pattern RGGB.
    #[serde(skip_serializing)]
    mosaic: bool,
    /// Whether every second pixel has the lower gain that goes with alpha.
    #[serde(skip_serializing)]
    two_gains: bool,
    /// Rows and columns.
    #[serde(skip_serializing)]
    size: (usize, usize),
    #[serde(skip_serializing)]
    background: Background,
    /// The changes of the background, one after the other.
    #[serde(skip_serializing)]
    draw: Vec<Draw>,
    #[serde(skip_serializing)]
    light: Light,
    #[serde(skip_serializing)]
    red: Option<Red>,
    /// The expected result by the name of the method, and that of the others as `all`; exact without an entry.
    #[serde(skip_serializing)]
    expected: BTreeMap<String, Expect>,
}

impl Default for Case {
    fn default() -> Self {
        let (name, family, what, why) = Default::default();
        let (lens, background, draw, light, expected) = Default::default();
        Self {
            name,
            family,
            what,
            why,
            twin: None,
            bits: 8,
            alpha: 4.0,
            read_noise: 0.0,
            lens,
            mosaic: false,
            two_gains: false,
            size: SIZE,
            background,
            draw,
            light,
            red: None,
            expected,
        }
    }
}

impl Case {
    /// The heading of its family.
    pub fn family(&self) -> &'static str {
        let family = FAMILIES.iter().find(|family| family.name == self.family);
        &family.expect("each case is in its family").title
    }

    /// Whether the modulo image is enough to know k.
    pub fn is_observable(&self) -> bool {
        self.twin.is_none()
    }

    pub(super) fn is_of(&self, family: &Family) -> bool {
        self.family == family.name
    }

    pub(super) fn expected(&self, method: &str) -> &Expect {
        self.expected.get(method).or_else(|| self.expected.get("all")).unwrap_or(&Expect::Exact)
    }

    /// Returns the methods that can unwrap the images of the sensor.
    pub fn methods(&self) -> Vec<Box<dyn Unwrap>> {
        let method =
            |name: &&str| by_name(name, &Options::default()).expect("a method of the list with its defaults");
        of_gains(self.gains()).map_or_else(|| METHODS.iter().map(method).collect(), |method| vec![method])
    }

    fn gains(&self) -> Gains {
        if self.two_gains { Gains::checkerboard(self.alpha) } else { Gains::One }
    }

    /// Draws the scene and exposes the sensor to it.
    ///
    /// # Errors
    /// [`SensorError`] for an impossible sensor or image, which no case of the catalogue has.
    pub fn expose(&self) -> Result<Exposure, SensorError> {
        let image = match &self.background {
            Background::Rendered(preset) => rendered(preset, self.alpha),
            background => {
                let image =
                    self.draw.iter().fold(background.image(self.size), |image, draw| draw.apply(&image));
                self.light.on(&image)
            }
        };
        let image = self.red.iter().fold(image, |image, red| red.apply(image));
        let psf = match self.lens {
            Lens::Perfect => Psf::None,
            Lens::Paper7 => Psf::Paper7,
            Lens::Gaussian(sigma) => Psf::Gaussian { sigma },
        };
        let sensor = SensorConfig {
            bits: self.bits,
            alpha: self.alpha,
            psf,
            read_noise: self.read_noise,
            gains: self.gains(),
            mosaic: self.mosaic.then_some(Mosaic::Rggb),
            ..SensorConfig::PLAIN
        };
        // Scenes are drawn in codes of 8 bits. A sensor of other bits sees the same scene in units of its peak, so that
        // its range is alpha peaks as well.
        let full_scale = (256.0 * self.alpha) as f32;
        Sensor::new(sensor)?.expose(image.mapv_into(|codes| codes / full_scale).view(), SEED)
    }
}
