//! Average precision (AP) as COCO defines it: the mean over 101 recalls of the best precision at that recall or above.

use std::collections::{BTreeMap, BTreeSet};

use modulo_bags::source::GroundTruth;
use modulo_core::Detection;

use crate::difficulty::{DONT_CARE, Difficulty};
use crate::matching::{ImageBoxes, MatchOutcome, ObjectRole};

/// Number of recalls at which the curve is sampled: 0, 0.01, ..., 1.
pub const RECALLS: usize = 101;

/// The definition of AP50 and of the precision-recall curve for the report.
pub const DEFINITION: &str = "\
    Detections take, by descending score, the free object of largest IoU of at least the threshold (one to \
    one, at most 100 detections an image and category). Precision at a recall is the best precision at that \
    recall or above; AP is its mean over the recalls 0, 0.01, ..., 1. Ignored objects, DontCare areas and \
    detections that lie at least half in them are not scored.";

/// The ten thresholds of AP50:95.
pub fn thresholds() -> impl Iterator<Item = f64> {
    // The same values as numpy.linspace(0.5, 0.95, 10).
    (0..10).map(|step| 0.5 + f64::from(step) * (0.45 / 9.0))
}

/// AP at one IoU threshold. `None` if no object is scored.
pub fn ap(images: &[ImageBoxes], least_iou: f64) -> Option<f64> {
    Sample::new(images, least_iou).ap(&vec![1; images.len()])
}

/// Mean AP over [`thresholds`]. `None` if no object is scored.
pub fn ap50_95(images: &[ImageBoxes]) -> Option<f64> {
    mean(thresholds().map(|threshold| ap(images, threshold)).collect::<Option<Vec<f64>>>()?)
}

/// The mean of figures. `None` without any.
pub fn mean(figures: impl IntoIterator<Item = f64>) -> Option<f64> {
    let (sum, count) = figures.into_iter().fold((0.0, 0u32), |(sum, n), figure| (sum + figure, n + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// The matched detections of several images at one threshold, for repeated drawing by the bootstrap.
#[derive(Clone, Debug)]
pub struct Sample {
    /// The score of each detection that is right or wrong, whether it is right, and the index of its image, by descending score.
    marks: Vec<(f32, bool, usize)>,
    objects: Vec<u64>,
}

impl Sample {
    /// Matches the detections of all images.
    pub fn new(images: &[ImageBoxes], least_iou: f64) -> Self {
        let mut marks = Vec::new();
        for (place, image) in images.iter().enumerate() {
            let outcomes = image.outcomes(least_iou).into_iter();
            let scored = outcomes.filter(|(_, outcome)| *outcome != MatchOutcome::Ignored);
            marks
                .extend(scored.map(|(i, outcome)| (image.found[i].1, outcome == MatchOutcome::Right, place)));
        }
        // The sort is stable, as that of pycocotools (mergesort): equal scores keep the order of the images, on which
        // AP depends.
        marks.sort_by(|a, b| b.0.total_cmp(&a.0));
        Self { marks, objects: images.iter().map(|image| image.objects() as u64).collect() }
    }

    /// AP of a data set that has image i `times[i]` times. `None` if no object is scored.
    pub fn ap(&self, times: &[u64]) -> Option<f64> {
        mean(self.curve(times)?)
    }

    /// The number of objects of all images.
    pub fn objects(&self) -> usize {
        self.objects.iter().sum::<u64>() as usize
    }

    /// The number of objects that are found in each image with a score of at least `least`.
    pub fn found(&self, least: f32) -> Vec<u64> {
        let mut found = vec![0; self.objects.len()];
        let right = self.marks.iter().filter(|(score, is_right, _)| *is_right && *score >= least);
        right.for_each(|(_, _, place)| found[*place] += 1);
        found
    }

    /// Precision at each of the [`RECALLS`].
    fn curve(&self, times: &[u64]) -> Option<Vec<f64>> {
        let objects: u64 = self.objects.iter().zip(times).map(|(objects, times)| objects * times).sum();
        let marks = self.marks.iter().map(|(_, is_right, place)| (*is_right, times[*place]));
        (objects > 0).then(|| precisions(marks, objects))
    }
}

/// The precision curve of detections (whether it is right, weight) by descending score, for `objects` > 0.
pub fn precisions(marks: impl Iterator<Item = (bool, u64)>, objects: u64) -> Vec<f64> {
    let (mut right, mut seen) = (0, 0);
    let mut points: Vec<(f64, f64)> = Vec::new();
    for (is_right, times) in marks.filter(|(_, times)| *times > 0) {
        seen += times;
        right += if is_right { times } else { 0 };
        points.push((right as f64 / objects as f64, right as f64 / seen as f64));
    }
    // Precision at a recall is the best one at that recall or above, which makes the curve fall. It is computed from
    // the end.
    let mut best: f64 = 0.0;
    for point in points.iter_mut().rev() {
        best = best.max(point.1);
        point.1 = best;
    }
    // Recalls and points both rise, so that one pass over the points serves all recalls.
    let mut at = 0;
    let read = |step: usize| {
        // The same values as numpy.linspace(0, 1, 101), whose 0.35 is slightly larger than 7/20.
        let recall = if step + 1 == RECALLS { 1.0 } else { step as f64 * 0.01 };
        while points.get(at).is_some_and(|(reached, _)| *reached < recall) {
            at += 1;
        }
        points.get(at).map_or(0.0, |(_, precision)| *precision)
    };
    (0..RECALLS).map(read).collect()
}

/// One frame: its detections and its ground truth.
pub type ScoredFrame = (Vec<Detection>, Vec<GroundTruth>);

/// The images of each class that has an object of `difficulty`.
pub fn by_class(frames: &[ScoredFrame], difficulty: Difficulty) -> BTreeMap<String, Vec<ImageBoxes>> {
    let objects = frames.iter().flat_map(|(_, truth)| truth);
    let classes: BTreeSet<&str> =
        objects.filter(|t| difficulty.role(t) == ObjectRole::Counts).map(|t| t.class.as_str()).collect();
    let of_class = |class: &str| {
        let own = |other: &str| if other == class { Membership::Member } else { Membership::Other };
        (class.to_owned(), images(frames, difficulty, own))
    };
    classes.into_iter().map(of_class).collect()
}

/// Relation of a class to the category that is scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Membership {
    /// The class is scored in the category.
    Member,
    /// Objects of the class are ignored in the category: it is similar, so that detecting it is not an error.
    Ignored,
    /// The class does not belong to the category.
    Other,
}

/// The images of `frames` for matching, each as [`image_boxes`] makes it.
pub fn images(
    frames: &[ScoredFrame],
    difficulty: Difficulty,
    membership: impl Fn(&str) -> Membership,
) -> Vec<ImageBoxes> {
    let boxes = |(found, truth): &ScoredFrame| image_boxes(found, truth, difficulty, &membership);
    frames.iter().map(boxes).collect()
}

/// The boxes of one image for matching. `membership` gives the relation of each class to the category that is scored.
pub fn image_boxes(
    found: &[Detection],
    truth: &[GroundTruth],
    difficulty: Difficulty,
    membership: impl Fn(&str) -> Membership,
) -> ImageBoxes {
    let role = |label: &GroundTruth| match membership(&label.class) {
        _ if label.class == DONT_CARE => Some(ObjectRole::Area),
        Membership::Member => Some(difficulty.role(label)),
        Membership::Ignored => Some(ObjectRole::Ignored),
        Membership::Other => None,
    };
    // Detections of a class that is ignored in the group are left out: they can neither hit nor miss a scored object.
    let found = found.iter().filter(|d| membership(&d.class) == Membership::Member);
    ImageBoxes {
        truth: truth.iter().filter_map(|label| Some((label.bbox, role(label)?))).collect(),
        found: found.map(|d| (d.bbox, d.score)).collect(),
        least_height: difficulty.least_height(),
    }
}

#[cfg(test)]
mod tests {
    use modulo_core::BBox;
    use serde_json::Value;

    use super::*;

    #[test]
    fn a_confident_mistake_costs_precision() {
        let curve = precisions([(false, 1), (true, 1)].into_iter(), 1);
        assert_eq!((curve.len(), mean(curve)), (RECALLS, Some(0.5)));
    }

    #[test]
    fn half_of_the_objects_fill_half_of_the_curve() {
        let curve = precisions([(true, 1)].into_iter(), 2);
        assert_eq!(curve.iter().filter(|p| **p == 1.0).count(), 51);
        assert_eq!(curve.iter().sum::<f64>(), 51.0);
    }

    #[test]
    fn to_count_twice_is_to_be_there_twice() {
        let weighted = precisions([(true, 2), (false, 3), (true, 0), (true, 1)].into_iter(), 4);
        let single = [true, true, false, false, false, true].into_iter().map(|right| (right, 1));
        assert_eq!(weighted, precisions(single, 4));
    }

    #[test]
    fn an_image_drawn_twice_is_two_images() {
        let image = |found: &[(f32, f32)]| ImageBoxes {
            truth: vec![(bbox(0.0, 9.0), ObjectRole::Counts)],
            found: found.iter().map(|(x, score)| (bbox(*x, 9.0), *score)).collect(),
            least_height: 0.0,
        };
        let (a, b) = (image(&[(0.0, 0.9), (50.0, 0.8)]), image(&[(50.0, 0.85)]));
        let sample = Sample::new(&[a.clone(), b.clone()], 0.5);
        assert_eq!(sample.ap(&[1, 1]), ap(&[a.clone(), b.clone()], 0.5));
        assert_eq!(sample.ap(&[2, 1]), ap(&[a.clone(), b, a], 0.5));
        assert_eq!(sample.ap(&[0, 0]), None);
    }

    #[test]
    fn without_objects_there_is_no_curve() {
        assert_eq!((ap(&[ImageBoxes::default()], 0.5), ap50_95(&[])), (None, None));
    }

    fn bbox(x: f32, size: f32) -> BBox {
        BBox { x1: x, y1: 0.0, x2: x + size, y2: size }
    }

    fn object(x: f32, size: f32, occluded: i32) -> GroundTruth {
        GroundTruth { bbox: bbox(x, size), class: "car".into(), truncated: 0.0, occluded }
    }

    fn detection(x: f32, size: f32, score: f32) -> Detection {
        Detection { bbox: bbox(x, size), score, class: "car".into() }
    }

    fn ap50(found: Vec<Detection>, truth: Vec<GroundTruth>) -> f64 {
        ap(&by_class(&[(found, truth)], Difficulty::Moderate)["car"], 0.5).expect("a car counts")
    }

    #[test]
    fn ignore_regions_neither_help_nor_harm() {
        let truth = || vec![object(0.0, 30.0, 0), object(100.0, 30.0, 2), object(200.0, 8.0, 0)];
        let dont_care = GroundTruth { class: DONT_CARE.into(), ..object(300.0, 90.0, -1) };
        let truth = || [truth(), vec![dont_care.clone()]].concat();
        let right = detection(0.0, 30.0, 0.5);
        for bad in [detection(100.0, 30.0, 0.9), detection(200.0, 8.0, 0.9), detection(310.0, 30.0, 0.9)] {
            assert_eq!(ap50(vec![bad, right.clone()], truth()), 1.0);
        }
        for (difficulty, objects) in [(Difficulty::Moderate, 1), (Difficulty::All, 3)] {
            let images = &by_class(&[(vec![], truth())], difficulty)["car"];
            assert_eq!((ap(images, 0.5), images[0].objects()), (Some(0.0), objects));
        }
    }

    #[test]
    fn without_objects_there_is_no_class() {
        let scores = by_class(&[(vec![detection(0.0, 30.0, 0.9)], vec![])], Difficulty::Moderate);
        assert!(scores.is_empty());
    }

    /// Figures of pycocotools on synthetic boxes, by `tests/peers/coco_reference.py`.
    const GOLDEN: &str = include_str!("../tests/data/coco_golden.json");

    /// Reads x, y, width, height and a last number.
    fn golden_row(row: &Value) -> (BBox, f32) {
        let numbers: Vec<f32> =
            row.as_array().expect("a row").iter().map(|n| n.as_f64().expect("a number") as f32).collect();
        let [x, y, width, height, last] = numbers[..] else { panic!("five numbers: {row}") };
        (BBox { x1: x, y1: y, x2: x + width, y2: y + height }, last)
    }

    fn golden_images(case: &Value) -> Vec<ImageBoxes> {
        let rows = |value: &Value| value.as_array().expect("rows").iter().map(golden_row).collect::<Vec<_>>();
        let role = |crowd: f32| if crowd == 1.0 { ObjectRole::Area } else { ObjectRole::Counts };
        let image = |image: &Value| ImageBoxes {
            truth: rows(&image["truth"]).into_iter().map(|(bbox, crowd)| (bbox, role(crowd))).collect(),
            found: rows(&image["found"]),
            least_height: 0.0,
        };
        case["images"].as_array().expect("images").iter().map(image).collect()
    }

    #[test]
    fn figures_are_those_of_pycocotools() {
        let cases: Vec<Value> = serde_json::from_str(GOLDEN).expect("JSON");
        assert_eq!(cases.len(), 5);
        for (number, case) in cases.iter().enumerate() {
            let images = golden_images(case);
            let near = |ours: Option<f64>, theirs: &Value| {
                let (ours, theirs) = (ours.expect("objects"), theirs.as_f64().expect("a number"));
                assert!((ours - theirs).abs() < 1e-6, "case {number}: {ours} against {theirs}");
            };
            near(ap(&images, 0.5), &case["ap50"]);
            near(ap50_95(&images), &case["ap50_95"]);
            let ours = Sample::new(&images, 0.5).curve(&vec![1; images.len()]).expect("objects");
            let theirs = case["precision50"].as_array().expect("a curve");
            assert_eq!(ours.len(), theirs.len());
            ours.iter().zip(theirs).for_each(|(ours, theirs)| near(Some(*ours), theirs));
        }
    }
}
