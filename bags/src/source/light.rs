//! [`Light`]: a simulated change of the light over the frames of a source, as a factor of their radiance.
//!
//! Recorded drives and rendered scenes have the light of their exposure control or of their preset. To test an exposure control, the light has to
//! change within the drive. `SOURCE?light=NAME` names the change.

use std::path::Path;

use super::SourceError;

/// A change of the light: it is bright and dark by turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Light {
    /// The number of frames of one light.
    length: u64,
    /// The frames that the change takes.
    change: u64,
    /// The darker light over the brighter one.
    dark: f64,
}

/// The drive enters a tunnel, or leaves it.
const TUNNELS: Light = Light { length: 50, change: 6, dark: 1.0 / 16.0 };
/// The drive passes from the sun into the shade of a tree, or back.
const TREES: Light = Light { length: 12, change: 2, dark: 1.0 / 6.0 };

impl Light {
    /// Returns the light of frame `number` as a factor of that of the source, at most 1: bright first, then by turns. Within a change, the
    /// factor between two frames is always the same.
    pub fn factor(self, number: u64) -> f64 {
        let Self { length, change, dark } = self;
        let (turn, within) = (number / length, number % length);
        let done = ((within + 1) as f64 / change as f64).min(1.0);
        let darkness = match turn {
            0 => 0.0,
            turn if turn % 2 == 1 => done,
            _ => 1.0 - done,
        };
        dark.powf(darkness)
    }
}

/// Splits the address of a source from the change of its light.
///
/// # Errors
/// [`SourceError::Unreadable`] of an unknown change.
pub fn split(spec: &str) -> Result<(String, Option<Light>), SourceError> {
    let whole = || Ok((spec.to_owned(), None));
    // A file may have a question mark in its name, and the query of a live stream is its own.
    if Path::new(spec).exists() || (spec.contains("://") && !spec.starts_with("scene://")) {
        return whole();
    }
    let Some((name, query)) = spec.split_once('?') else { return whole() };
    let (light, others): (Vec<&str>, Vec<&str>) =
        query.split('&').partition(|part| part.starts_with("light="));
    let Some(word) = light.last().and_then(|part| part.strip_prefix("light=")) else { return whole() };
    let light = match word {
        "tunnels" => TUNNELS,
        "trees" => TREES,
        _ => {
            let why = format!("{spec}: light '{word}' is unknown, tunnels and trees are known");
            return Err(SourceError::Unreadable(why));
        }
    };
    let query = others.join("&");
    Ok((if query.is_empty() { name.to_owned() } else { format!("{name}?{query}") }, Some(light)))
}

#[cfg(test)]
mod tests {
    use super::super::{SourceOptions, open};
    use super::*;

    #[test]
    fn the_light_changes_by_turns_and_smoothly() {
        let factor = |number| TUNNELS.factor(number);
        assert!((0..50).all(|number| factor(number) == 1.0));
        assert!((56..100).all(|number| (factor(number) - 1.0 / 16.0).abs() < 1e-9));
        assert!((106..150).all(|number| (factor(number) - 1.0).abs() < 1e-9));
        for light in [TUNNELS, TREES] {
            let largest =
                (0..400).map(|n| (light.factor(n + 1) / light.factor(n)).ln().abs()).fold(0.0, f64::max);
            assert!(largest < 1.0, "at most a factor of e between two frames: {largest}");
        }
    }

    #[test]
    fn a_source_under_changing_light_is_the_source_times_the_factor() {
        let frames = |spec: &str, skipped: u64| {
            let mut source = open(spec, &SourceOptions::default()).expect("a scene");
            source.pass(skipped);
            source.map(|frame| frame.expect("a frame").radiance)
        };
        let plain = "scene://day?seed=3&width=48&height=16&frames=60";
        for skipped in [0, 45] {
            let relit = frames(&format!("{plain}&light=tunnels"), skipped);
            for (number, (plain, relit)) in (skipped..).zip(frames(plain, skipped).zip(relit)) {
                let factor = TUNNELS.factor(number) as f32;
                assert_eq!(plain.mapv(|radiance| factor * radiance), relit);
            }
        }
    }

    #[test]
    fn only_the_light_is_taken_from_an_address() {
        for (spec, rest, light) in [
            ("scene://day?seed=3&light=trees&frames=2", "scene://day?seed=3&frames=2", Some(TREES)),
            ("drive?light=tunnels", "drive", Some(TUNNELS)),
            ("scene://day", "scene://day", None),
            ("http://camera/video?light=trees", "http://camera/video?light=trees", None),
        ] {
            assert_eq!(split(spec).expect("known"), (rest.to_owned(), light));
        }
        let why = split("drive?light=dusk").expect_err("unknown").to_string();
        assert!(why.contains("'dusk'") && why.contains("tunnels and trees"), "{why}");
    }
}
