//! AP50 by class, as a launch file's evaluation reports it.
//!
//! Which objects count is the rule of the grid, [`super::difficulty`]; how
//! detections are matched and averaged is in [`super::matching`] and
//! [`super::average`].

use std::collections::{BTreeMap, BTreeSet};

use modulo_bags::source::GroundTruth;
use modulo_core::{BBox, Detection};

use super::average;
use super::matching::{Image, Role};
use crate::classes::DONT_CARE;
use crate::results::Difficulty;

const IOU: f64 = 0.5;

/// One frame: what a detector said, and what is there.
pub type Scored = (Vec<Detection>, Vec<GroundTruth>);

/// AP50 of each class that has at least one object that counts at `difficulty`,
/// with the number of these objects.
pub fn by_class(frames: &[Scored], difficulty: Difficulty) -> BTreeMap<String, (f64, usize)> {
    let objects = frames.iter().flat_map(|(_, truth)| truth);
    let classes: BTreeSet<&str> =
        objects.filter(|t| difficulty.role(t) == Role::Counts).map(|t| t.class.as_str()).collect();
    let score = |class: &str| {
        let images: Vec<Image> = frames.iter().map(|frame| image(frame, class, difficulty)).collect();
        let objects = images.iter().map(Image::objects).sum();
        Some((class.to_owned(), (average::ap(&images, IOU)?, objects)))
    };
    classes.into_iter().filter_map(score).collect()
}

/// The mean over classes; `None` when no object counts.
pub fn mean(by_class: &BTreeMap<String, (f64, usize)>) -> Option<f64> {
    let figures: Vec<f64> = by_class.values().map(|(ap, _)| *ap).collect();
    (!figures.is_empty()).then(|| average::mean(&figures))
}

fn image((found, truth): &Scored, class: &str, difficulty: Difficulty) -> Image {
    let of_class = truth.iter().filter(|t| t.class == class || t.class == DONT_CARE);
    let boxes = |d: &Detection| -> (BBox, f32) { (d.bbox, d.score) };
    Image {
        truth: of_class.map(|t| (t.bbox, difficulty.role(t))).collect(),
        found: found.iter().filter(|d| d.class == class).map(boxes).collect(),
        least_height: difficulty.least_height(),
    }
}

#[cfg(test)]
mod tests {
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
