//! The address of a scene: `scene://glare?seed=3&frames=60&width=640&height=192`.
//!
//! The scheme may be omitted.

use super::{Preset, Scene};
use std::str::FromStr;

/// The largest side of a rendered image in px.
const LARGEST: usize = 8192;

/// The specification of a rendered sequence: a preset, a seed, a size and a length.
///
/// ```
/// let spec: modulo_scene::SceneSpec = "scene://tunnel?seed=3&width=64&height=32".parse()?;
/// let frame = spec.scene().render(0, spec.height, spec.width);
/// assert_eq!(frame.radiance.dim(), (32, 64, 3));
/// # Ok::<(), modulo_scene::SpecError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneSpec {
    /// The light and the location.
    pub preset: Preset,
    /// The seed, 0 by default.
    pub seed: u64,
    /// The number of columns, 1 to 8192, 640 by default.
    pub width: usize,
    /// The number of rows, 1 to 8192, 192 by default.
    pub height: usize,
    /// The number of frames; 0, the default, means without end.
    pub frames: u32,
}

/// Error: the text is not the address of a scene.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SpecError {
    /// The scheme is not `scene://`.
    #[error("'{0}' is no scene, a scene starts with scene://")]
    Scheme(String),
    /// The preset is unknown.
    #[error("scene preset '{0}' is unknown, day, glare, tunnel and night are known")]
    Preset(String),
    /// An option is unknown.
    #[error("scene option '{0}' is unknown, seed, width, height and frames are known")]
    Option(String),
    /// The value of an option is not allowed.
    #[error("scene option {name} is '{value}', {allowed} is allowed")]
    Value {
        /// The name of the option.
        name: String,
        /// The text of the value.
        value: String,
        /// The values that are allowed.
        allowed: &'static str,
    },
}

impl SceneSpec {
    /// Returns the scene without its size.
    pub fn scene(&self) -> Scene {
        Scene::new(self.preset, self.seed)
    }
}

impl FromStr for SceneSpec {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        let rest = text.strip_prefix("scene://").unwrap_or(text);
        // The scheme may be left out, but another scheme is an error of its own and not an unknown preset.
        if rest.contains("://") {
            return Err(SpecError::Scheme(text.to_owned()));
        }
        let (name, options) = rest.split_once('?').unwrap_or((rest, ""));
        let known = Preset::ALL.into_iter().find(|p| p.name() == name);
        let preset = known.ok_or_else(|| SpecError::Preset(name.to_owned()))?;
        let mut spec = Self { preset, seed: 0, width: 640, height: 192, frames: 0 };
        for option in options.split('&').filter(|o| !o.is_empty()) {
            let (name, value) = option.split_once('=').unwrap_or((option, ""));
            match name {
                "seed" => spec.seed = number(name, value, "a whole number from 0")?,
                "width" => spec.width = side(name, value)?,
                "height" => spec.height = side(name, value)?,
                "frames" => spec.frames = number(name, value, "a whole number from 0")?,
                _ => return Err(SpecError::Option(name.to_owned())),
            }
        }
        Ok(spec)
    }
}

fn side(name: &str, value: &str) -> Result<usize, SpecError> {
    let allowed = "a whole number from 1 to 8192";
    let found = number(name, value, allowed)?;
    if (1..=LARGEST).contains(&found) { Ok(found) } else { Err(wrong(name, value, allowed)) }
}

fn number<T: FromStr>(name: &str, value: &str, allowed: &'static str) -> Result<T, SpecError> {
    value.parse().map_err(|_| wrong(name, value, allowed))
}

fn wrong(name: &str, value: &str, allowed: &'static str) -> SpecError {
    SpecError::Value { name: name.to_owned(), value: value.to_owned(), allowed }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_addresses() {
        let full: Result<SceneSpec, _> = "scene://glare?seed=3&width=320&height=96&frames=9".parse();
        let expected = SceneSpec { preset: Preset::Glare, seed: 3, width: 320, height: 96, frames: 9 };
        assert_eq!(full, Ok(expected));
        let short: SceneSpec = "night".parse().unwrap();
        assert_eq!(short, SceneSpec { preset: Preset::Night, seed: 0, width: 640, height: 192, frames: 0 });
    }

    #[test]
    fn errors_name_the_part_and_what_is_allowed() {
        let says = |text: &str| text.parse::<SceneSpec>().unwrap_err().to_string();
        assert_eq!(says("fog"), "scene preset 'fog' is unknown, day, glare, tunnel and night are known");
        assert_eq!(
            says("day?size=3"),
            "scene option 'size' is unknown, seed, width, height and frames are known"
        );
        assert_eq!(
            says("day?width=0"),
            "scene option width is '0', a whole number from 1 to 8192 is allowed"
        );
        assert_eq!(says("day?seed=-1"), "scene option seed is '-1', a whole number from 0 is allowed");
        assert_eq!(says("kitti://x"), "'kitti://x' is no scene, a scene starts with scene://");
    }
}
