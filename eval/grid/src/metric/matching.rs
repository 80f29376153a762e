//! Matching of detections and objects as in COCO: one to one, by descending score. The difficulties of KITTI determine the
//! objects that are scored.

use clap::ValueEnum;
use modulo_bags::source::{CROWD, GroundTruth};
use modulo_core::BBox;

use crate::classes::DONT_CARE;
use crate::results::Difficulty;

/// Treatment of an object in the score.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObjectRole {
    /// The object is scored: it should be found once.
    Counts,
    /// The object is ignored, whether it is found or not.
    Ignored,
    /// An area in which objects are not labelled one by one (DontCare, a crowd). Detections in it are ignored.
    Area,
}

/// The boxes of one image and category.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImageBoxes {
    /// Labelled boxes.
    pub truth: Vec<(BBox, ObjectRole)>,
    /// Detected boxes with their scores.
    pub found: Vec<(BBox, f32)>,
    /// Unmatched detections lower than this, px, are ignored.
    pub least_height: f32,
}

/// A detection that is right or wrong. Ignored detections have no mark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mark {
    /// Score of the detection.
    pub score: f32,
    /// Whether it found a scored object.
    pub right: bool,
}

/// The result of matching a detection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MatchOutcome {
    /// It found a scored object.
    Right,
    /// It found no object.
    Wrong,
    /// It found an object or area that is ignored, or is too small to be scored.
    Ignored,
}

/// Number of detections of an image and category that are scored, those of the highest scores.
const MOST_DETECTIONS: usize = 100;

impl ImageBoxes {
    /// Number of scored objects.
    pub fn objects(&self) -> usize {
        self.truth.iter().filter(|(_, role)| *role == ObjectRole::Counts).count()
    }

    /// The scored detections as [`Self::outcomes`] has them.
    pub fn marks(&self, least_iou: f64) -> Vec<Mark> {
        let scored =
            self.outcomes(least_iou).into_iter().filter(|(_, outcome)| *outcome != MatchOutcome::Ignored);
        scored
            .map(|(i, outcome)| Mark { score: self.found[i].1, right: outcome == MatchOutcome::Right })
            .collect()
    }

    /// Matches the best `MOST_DETECTIONS` by descending score: each takes the free object of largest IoU, at least
    /// `least_iou`, scored objects before all others. Each outcome comes with the index of its detection.
    pub fn outcomes(&self, least_iou: f64) -> Vec<(usize, MatchOutcome)> {
        let mut order: Vec<usize> = (0..self.found.len()).collect();
        order.sort_by(|a, b| self.found[*b].1.total_cmp(&self.found[*a].1));
        order.truncate(MOST_DETECTIONS);
        // The order of the scores decides who takes an object: a detection of a lower score finds only the objects that
        // are left.
        let mut free = vec![true; self.truth.len()];
        let outcome = |index: usize| {
            let (bbox, _) = self.found[index];
            let hit = self.best(bbox, least_iou, &free).map(|object| (object, self.truth[object].1));
            // An area holds any number of objects, so that it stays free.
            if let Some((object, role)) = hit {
                free[object] = role == ObjectRole::Area;
            }
            let outcome = match hit {
                Some((_, ObjectRole::Counts)) => MatchOutcome::Right,
                Some(_) => MatchOutcome::Ignored,
                // Objects lower than this are not scored, so that a detection of this size without an object is no
                // error either.
                None if bbox.y2 - bbox.y1 < self.least_height => MatchOutcome::Ignored,
                None => MatchOutcome::Wrong,
            };
            (index, outcome)
        };
        order.into_iter().map(outcome).collect()
    }

    /// The object that a detection takes: of equal ones the last, as in the program of COCO.
    fn best(&self, bbox: BBox, least_iou: f64, free: &[bool]) -> Option<usize> {
        let among = |counts: bool| {
            let objects = self
                .truth
                .iter()
                .enumerate()
                .filter(|(index, (_, role))| free[*index] && (*role == ObjectRole::Counts) == counts);
            let overlaps = objects.map(|(index, (truth, role))| (overlap(bbox, *truth, *role), index));
            overlaps.filter(|(overlap, _)| *overlap >= least_iou).max_by(|a, b| a.0.total_cmp(&b.0))
        };
        // A scored object comes first, even if an ignored one overlaps more: else the detector would lose a hit.
        among(true).or_else(|| among(false)).map(|(_, index)| index)
    }
}

/// The IoU, or for an area the share of the detection that lies in it.
fn overlap(found: BBox, truth: BBox, role: ObjectRole) -> f64 {
    // In f64, as pycocotools computes it: f32 moves an IoU of exactly 0.5 to either side of the threshold.
    let common = area(
        f64::from(found.x2.min(truth.x2)) - f64::from(found.x1.max(truth.x1)),
        f64::from(found.y2.min(truth.y2)) - f64::from(found.y1.max(truth.y1)),
    );
    let [own, other] =
        [found, truth].map(|b| area(f64::from(b.x2) - f64::from(b.x1), f64::from(b.y2) - f64::from(b.y1)));
    let whole = if role == ObjectRole::Area { own } else { own + other - common };
    if whole > 0.0 { common / whole } else { 0.0 }
}

fn area(width: f64, height: f64) -> f64 {
    width.max(0.0) * height.max(0.0)
}

/// The definition of the difficulties for the report.
pub const DIFFICULTIES: &str = "\
    KITTI: easy: at least 40 px high, fully visible, at most 15 % outside the image; moderate: 25 px, partly \
    occluded, 30 %; hard: 25 px, largely occluded, 50 %; all: every label. Objects beyond that are ignored, \
    and lower detections are left out unless they find something. Missing annotations never exclude an \
    object.";

impl Difficulty {
    /// All difficulties, from easy to all.
    pub const ALL: [Self; 4] = [Self::Easy, Self::Moderate, Self::Hard, Self::All];

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
        f.write_str(self.to_possible_value().expect("no difficulty is hidden").get_name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f32, size: f32) -> BBox {
        BBox { x1: x, y1: 0.0, x2: x + size, y2: size }
    }

    fn rights(truth: &[(BBox, ObjectRole)], found: &[(BBox, f32)]) -> Vec<bool> {
        let image = ImageBoxes { truth: truth.to_vec(), found: found.to_vec(), least_height: 10.0 };
        image.marks(0.5).iter().map(|mark| mark.right).collect()
    }

    #[test]
    fn one_object_is_found_once() {
        let truth = [(square(0.0, 20.0), ObjectRole::Counts)];
        assert_eq!(rights(&truth, &[(square(0.0, 20.0), 0.3), (square(1.0, 20.0), 0.9)]), [true, false]);
    }

    #[test]
    fn what_counts_comes_before_what_is_ignored() {
        let truth = [(square(0.0, 20.0), ObjectRole::Ignored), (square(4.0, 20.0), ObjectRole::Counts)];
        assert_eq!(rights(&truth, &[(square(0.0, 20.0), 0.9)]), [true]);
        assert_eq!(rights(&truth, &[(square(0.0, 20.0), 0.9), (square(0.0, 20.0), 0.8)]), [true]);
    }

    #[test]
    fn an_area_takes_any_number_and_small_misses_are_left_out() {
        let truth = [(square(0.0, 200.0), ObjectRole::Area)];
        let inside = [(square(0.0, 20.0), 0.9), (square(50.0, 20.0), 0.8), (square(190.0, 20.0), 0.7)];
        assert_eq!(rights(&truth, &inside), [] as [bool; 0]);
        assert_eq!(rights(&truth, &[(square(300.0, 9.0), 0.9), (square(300.0, 11.0), 0.8)]), [false]);
    }

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
            let counting = Difficulty::ALL.map(|step| step.role(&label) == ObjectRole::Counts);
            assert_eq!(counting, std::array::from_fn(|step| step >= first), "{label:?}");
        }
    }

    #[test]
    fn areas_are_areas_at_every_step() {
        let area = GroundTruth { class: DONT_CARE.into(), ..label(80.0, -1, -1.0) };
        for step in Difficulty::ALL {
            assert_eq!(
                (step.role(&area), step.role(&label(80.0, CROWD, -1.0))),
                (ObjectRole::Area, ObjectRole::Area)
            );
        }
    }
}
