//! A scene's address: `scene://glare?seed=3&frames=60&width=640&height=192`.
//!
//! The scheme may be left out. Nothing here renders.

use super::{Preset, Scene};
use std::str::FromStr;

/// Largest side of a rendered image, px.
const LARGEST: usize = 8192;

/// What to render: a preset, a seed, a size and how long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneSpec {
    /// The kind of light and place.
    pub preset: Preset,
    /// Which of its scenes; 0 when not given.
    pub seed: u64,
    /// Columns, 1 to 8192; 640 when not given.
    pub width: usize,
    /// Rows, 1 to 8192; 192 when not given.
    pub height: usize,
    /// Frames until it ends; endless when not given or 0.
    pub frames: u32,
}

/// Why a text is no scene.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SpecError {
    /// Another scheme than `scene://`.
    #[error("'{0}' is no scene, a scene starts with scene://")]
    Scheme(String),
    /// An unknown preset.
    #[error("scene preset '{0}' is unknown, day, glare, tunnel and night are known")]
    Preset(String),
    /// An unknown option.
    #[error("scene option '{0}' is unknown, seed, width, height and frames are known")]
    Option(String),
    /// A value that is not allowed.
    #[error("scene option {name} is '{value}', {allowed} is allowed")]
    Value {
        /// The option.
        name: String,
        /// The text found.
        value: String,
        /// What is allowed.
        allowed: &'static str,
    },
}

impl SceneSpec {
    /// The scene itself, without its size.
    pub fn scene(&self) -> Scene {
        Scene::new(self.preset, self.seed)
    }
}

impl Scene {
    /// Reads `glare?seed=3`, with or without `scene://` before it.
    ///
    /// # Errors
    /// [`SpecError`] names the part that is wrong and what is allowed.
    pub fn parse(text: &str) -> Result<SceneSpec, SpecError> {
        text.parse()
    }
}

impl FromStr for SceneSpec {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        let rest = text.strip_prefix("scene://").unwrap_or(text);
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
        let full = Scene::parse("scene://glare?seed=3&width=320&height=96&frames=9").unwrap();
        let expected = SceneSpec { preset: Preset::Glare, seed: 3, width: 320, height: 96, frames: 9 };
        assert_eq!(full, expected);
        let short = Scene::parse("night").unwrap();
        assert_eq!(short, SceneSpec { preset: Preset::Night, seed: 0, width: 640, height: 192, frames: 0 });
    }

    #[test]
    fn errors_name_the_part_and_what_is_allowed() {
        let says = |text: &str| Scene::parse(text).unwrap_err().to_string();
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
