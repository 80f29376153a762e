//! [`Difficulty`]: the objects that are scored, as the benchmark of KITTI has them.

use modulo_bags::source::{CROWD, GroundTruth};
use serde::{Deserialize, Serialize};

use crate::matching::ObjectRole;

/// The class of areas that are never scored.
pub const DONT_CARE: &str = "dontcare";

/// The objects that are scored: the difficulties of KITTI, or all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Difficulty {
    /// At least 40 px high, fully visible, at most 15 % outside the image
    Easy,
    /// At least 25 px high, at most partly occluded, at most 30 % outside
    #[default]
    Moderate,
    /// At least 25 px high, at most largely occluded, at most 50 % outside
    Hard,
    /// Every label, for data sets without this information
    All,
}

/// The definition of the difficulties for the report.
pub const DIFFICULTIES: &str = "\
    KITTI: easy: at least 40 px high, fully visible, at most 15 % outside the image; moderate: 25 px, partly \
    occluded, 30 %; hard: 25 px, largely occluded, 50 %; all: every label. Objects beyond that are ignored, \
    and lower detections are left out unless they find something. Missing annotations never exclude an \
    object.";

impl Difficulty {
    /// All difficulties with their words, from easy to all.
    pub const WORDS: [(&'static str, Self); 4] =
        [("easy", Self::Easy), ("moderate", Self::Moderate), ("hard", Self::Hard), ("all", Self::All)];

    /// Least height of scored objects, and of detections that count as errors, px.
    pub fn least_height(self) -> f32 {
        match self {
            Self::Easy => 40.0,
            Self::Moderate | Self::Hard => 25.0,
            Self::All => 0.0,
        }
    }

    /// The role of an object of the category that is scored.
    pub fn role(self, label: &GroundTruth) -> ObjectRole {
        let (occluded, truncated) = match self {
            Self::Easy => (0, 0.15),
            Self::Moderate => (1, 0.30),
            Self::Hard => (2, 0.50),
            // A crowd has the largest code of occlusion, and is an area at every difficulty.
            Self::All => (CROWD - 1, f32::INFINITY),
        };
        if label.class == DONT_CARE || label.occluded == CROWD {
            return ObjectRole::Area;
        }
        let counts = label.bbox.y2 - label.bbox.y1 >= self.least_height()
            && label.occluded <= occluded
            && label.truncated <= truncated;
        if counts { ObjectRole::Counts } else { ObjectRole::Ignored }
    }
}

impl std::fmt::Display for Difficulty {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let word = Self::WORDS.iter().find(|(_, difficulty)| difficulty == self);
        f.write_str(word.expect("every difficulty has a word").0)
    }
}

#[cfg(test)]
mod tests {
    use modulo_core::BBox;

    use super::*;

    fn label(height: f32, occluded: i32, truncated: f32) -> GroundTruth {
        let bbox = BBox { x1: 0.0, y1: 0.0, x2: 9.0, y2: height };
        GroundTruth { bbox, class: "car".into(), truncated, occluded }
    }

    #[test]
    fn each_step_lets_more_objects_count() {
        for (label, first) in [
            (label(40.0, 0, 0.15), 0),
            (label(39.9, 0, 0.0), 1),
            (label(25.0, 1, 0.3), 1),
            (label(80.0, 2, 0.0), 2),
            (label(80.0, 0, 0.5), 2),
            (label(24.9, 0, 0.0), 3),
            (label(80.0, 3, 0.0), 3),
            (label(80.0, 0, 0.9), 3),
            (label(80.0, -1, -1.0), 0),
        ] {
            let counting = Difficulty::WORDS.map(|(_, step)| step.role(&label) == ObjectRole::Counts);
            assert_eq!(counting, std::array::from_fn(|step| step >= first), "{label:?}");
        }
    }

    #[test]
    fn areas_are_areas_at_every_step() {
        let area = GroundTruth { class: DONT_CARE.into(), ..label(80.0, -1, -1.0) };
        for (_, step) in Difficulty::WORDS {
            assert_eq!(
                (step.role(&area), step.role(&label(80.0, CROWD, -1.0))),
                (ObjectRole::Area, ObjectRole::Area)
            );
        }
    }
}
