//! Matching of detections and objects as in COCO: one to one, by descending score.

use modulo_core::BBox;

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

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f32, size: f32) -> BBox {
        BBox { x1: x, y1: 0.0, x2: x + size, y2: size }
    }

    fn rights(truth: &[(BBox, ObjectRole)], found: &[(BBox, f32)]) -> Vec<bool> {
        let image = ImageBoxes { truth: truth.to_vec(), found: found.to_vec(), least_height: 10.0 };
        let outcomes = image.outcomes(0.5).into_iter().map(|(_, outcome)| outcome);
        let scored = outcomes.filter(|outcome| *outcome != MatchOutcome::Ignored);
        scored.map(|outcome| outcome == MatchOutcome::Right).collect()
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
}
