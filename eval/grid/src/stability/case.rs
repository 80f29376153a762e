//! [`Case`]: one scene of the catalogue, its sensor, and the expected result of each method.
//!
//! `scenes.json` is the catalogue: scenes that are hard for some methods.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use modulo_core::unwrap::{METHODS, Options, Unwrap, by_name, of_gains};
use modulo_core::{Exposure, Transfer};
use modulo_runtime::parameter::flat;
use modulo_runtime::sensor::parameters::BlurShape;
use modulo_runtime::{ParameterError, SensorModel};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

use super::expect::Expect;
use super::radiance::{Background, Draw, Light, Red, SIZE, rendered};
use crate::GridError;

/// Seed of the noise of the sensor, which is the same in all cases.
pub(super) const SEED: u64 = 3;

/// The catalogue in the order of the report.
pub static FAMILIES: LazyLock<Vec<Family>> = LazyLock::new(|| {
    let mut families: Vec<Family> =
        serde_json::from_str(include_str!("scenes.json")).expect("the tests read this file");
    for family in &mut families {
        family.scenes.iter_mut().for_each(|case| case.family.clone_from(&family.title));
    }
    families
});

/// A section of the catalogue.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Family {
    /// The heading.
    pub title: String,
    /// Its scenes.
    pub scenes: Vec<Case>,
}

/// Returns all cases, in the order of their families.
pub fn cases() -> Vec<&'static Case> {
    FAMILIES.iter().flat_map(|family| &family.scenes).collect()
}

/// Returns the sensor of most scenes: its lens is perfect, full scale is alpha peaks, and its pictures are encoded, which makes dark scenes
/// visible.
fn plain() -> SensorModel {
    let (headroom, transfer, psf) = (1.0, Transfer::Srgb, BlurShape::Gaussian);
    SensorModel { headroom, transfer, psf, ..SensorModel::unknown() }
}

/// Reads the parameters that differ from those of [`plain`].
fn sensor<'de, D: Deserializer<'de>>(from: D) -> Result<SensorModel, D::Error> {
    let given = serde_json::Map::deserialize(from)?;
    let mut all = flat::serialize(&plain(), serde_json::value::Serializer).map_err(D::Error::custom)?;
    all.as_object_mut().expect("parameters have names").extend(given);
    flat::deserialize(all).map_err(D::Error::custom)
}

/// A scene, its sensor, and the expected results.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Case {
    /// Unique name of lower-case letters, digits and `_`, which also names the pictures.
    pub name: String,
    /// The heading of its family.
    #[serde(skip)]
    pub family: String,
    /// The content of the scene.
    pub what: String,
    /// The reason for the results of the methods.
    #[serde(default)]
    pub why: String,
    /// If k is not observable: another scene with the same modulo image.
    pub(super) twin: Option<String>,
    /// Its sensor, which sees the same scene in units of its peak whatever its bits are.
    #[serde(default = "plain", deserialize_with = "sensor")]
    pub(super) sensor: SensorModel,
    /// Rows and columns.
    #[serde(default = "most")]
    size: (usize, usize),
    #[serde(default)]
    background: Background,
    /// The changes of the background, one after the other.
    #[serde(default)]
    draw: Vec<Draw>,
    #[serde(default)]
    light: Light,
    red: Option<Red>,
    /// The expected result by the name of the method, and that of the others as `all`; exact without an entry.
    #[serde(default)]
    expected: BTreeMap<String, Expect>,
}

fn most() -> (usize, usize) {
    SIZE
}

impl Case {
    /// Whether the modulo image is enough to know k.
    pub fn is_observable(&self) -> bool {
        self.twin.is_none()
    }

    pub(super) fn expected(&self, method: &str) -> &Expect {
        self.expected.get(method).or_else(|| self.expected.get("all")).unwrap_or(&Expect::Exact)
    }

    /// Returns the methods that can unwrap the images of the sensor.
    ///
    /// # Errors
    /// [`ParameterError`] for an impossible sensor, which no case of the catalogue has.
    pub fn methods(&self) -> Result<Vec<Box<dyn Unwrap>>, ParameterError> {
        let method =
            |name: &&str| by_name(name, &Options::default()).expect("a method of the list with its defaults");
        let gains = of_gains(self.sensor.gains()?);
        Ok(gains.map_or_else(|| METHODS.iter().map(method).collect(), |method| vec![method]))
    }

    /// Draws the scene and exposes the sensor to it.
    ///
    /// # Errors
    /// [`GridError`] for an impossible sensor or image, which no case of the catalogue has.
    pub fn expose(&self) -> Result<Exposure, GridError> {
        let image = match &self.background {
            Background::Rendered(preset) => rendered(preset, self.sensor.alpha),
            background => {
                let image =
                    self.draw.iter().fold(background.image(self.size), |image, draw| draw.apply(&image));
                self.light.on(&image)
            }
        };
        let image = self.red.iter().fold(image, |image, red| red.apply(image));
        // Scenes are drawn in codes of 8 bits. A sensor of other bits sees the same scene in units of its peak, so that
        // its range is alpha peaks as well.
        let full_scale = (256.0 * self.sensor.alpha) as f32;
        Ok(self.sensor.simulated()?.expose(image.mapv_into(|codes| codes / full_scale).view(), SEED)?)
    }
}
