//! AP50 of each class, as the evaluation of a launch file reports it.

use std::collections::{BTreeMap, BTreeSet};

use modulo_bags::source::GroundTruth;
use modulo_core::Detection;

use super::average;
use super::matching::{Image, Role};
use crate::classes::{DONT_CARE, Membership};
use crate::results::Difficulty;

const IOU: f64 = 0.5;

/// One frame: its detections and its ground truth.
pub type Scored = (Vec<Detection>, Vec<GroundTruth>);

/// AP50 and number of objects of each class that has an object of `difficulty`.
pub fn by_class(frames: &[Scored], difficulty: Difficulty) -> BTreeMap<String, (f64, usize)> {
    let objects = frames.iter().flat_map(|(_, truth)| truth);
    let classes: BTreeSet<&str> =
        objects.filter(|t| difficulty.role(t) == Role::Counts).map(|t| t.class.as_str()).collect();
    let score = |class: &str| {
        let own = |other: &str| if other == class { Membership::Member } else { Membership::Other };
        let images: Vec<Image> =
            frames.iter().map(|(found, truth)| image(found, truth, difficulty, own)).collect();
        let objects = images.iter().map(Image::objects).sum();
        Some((class.to_owned(), (average::ap(&images, IOU)?, objects)))
    };
    classes.into_iter().filter_map(score).collect()
}

/// The mean over the classes. `None` if there is no class.
pub fn mean(by_class: &BTreeMap<String, (f64, usize)>) -> Option<f64> {
    let figures: Vec<f64> = by_class.values().map(|(ap, _)| *ap).collect();
    (!figures.is_empty()).then(|| average::mean(&figures))
}

/// The boxes of one image for matching. `membership` gives the relation of each class to the category that is scored.
pub fn image(
    found: &[Detection],
    truth: &[GroundTruth],
    difficulty: Difficulty,
    membership: impl Fn(&str) -> Membership,
) -> Image {
    let role = |label: &GroundTruth| match membership(&label.class) {
        _ if label.class == DONT_CARE => Some(Role::Area),
        Membership::Member => Some(difficulty.role(label)),
        Membership::Ignored => Some(Role::Ignored),
        Membership::Other => None,
    };
    let found = found.iter().filter(|d| membership(&d.class) == Membership::Member);
    Image {
        truth: truth.iter().filter_map(|label| Some((label.bbox, role(label)?))).collect(),
        found: found.map(|d| (d.bbox, d.score)).collect(),
        least_height: difficulty.least_height(),
    }
}

#[cfg(test)]
mod tests {
    use modulo_core::BBox;

    use super::*;

    fn bbox(x: f32, size: f32) -> BBox {
        BBox { x1: x, y1: 0.0, x2: x + size, y2: size }
    }

    fn object(x: f32, size: f32, occluded: i32) -> GroundTruth {
        GroundTruth { bbox: bbox(x, size), class: "car".into(), truncated: 0.0, occluded }
    }

    fn detection(x: f32, size: f32, score: f32) -> Detection {
        Detection { bbox: bbox(x, size), score, class: "car".into() }
    }

    fn ap(found: Vec<Detection>, truth: Vec<GroundTruth>) -> f64 {
        by_class(&[(found, truth)], Difficulty::Moderate)["car"].0
    }

    #[test]
    fn ignore_regions_neither_help_nor_harm() {
        let truth = || vec![object(0.0, 30.0, 0), object(100.0, 30.0, 2), object(200.0, 8.0, 0)];
        let dont_care = GroundTruth { class: DONT_CARE.into(), ..object(300.0, 90.0, -1) };
        let truth = || [truth(), vec![dont_care.clone()]].concat();
        let right = detection(0.0, 30.0, 0.5);
        for bad in [detection(100.0, 30.0, 0.9), detection(200.0, 8.0, 0.9), detection(310.0, 30.0, 0.9)] {
            assert_eq!(ap(vec![bad, right.clone()], truth()), 1.0);
        }
        assert_eq!(by_class(&[(vec![], truth())], Difficulty::Moderate)["car"], (0.0, 1));
        assert_eq!(by_class(&[(vec![], truth())], Difficulty::All)["car"], (0.0, 3));
    }

    #[test]
    fn without_objects_there_is_no_score() {
        let scores = by_class(&[(vec![detection(0.0, 30.0, 0.9)], vec![])], Difficulty::Moderate);
        assert!(scores.is_empty() && mean(&scores).is_none());
    }
}
