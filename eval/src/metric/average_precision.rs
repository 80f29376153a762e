//! AP50: the mean over recall of the precision at IoU 0.5, as COCO defines it.
//!
//! Within a frame and a class, detections take, by descending score, the free
//! object with the largest IoU of at least 0.5. An object is an ignore region
//! when it is less than 12 px high, more than half hidden, or `dontcare`: found
//! or not, it neither helps nor harms. A detection less than 12 px high that
//! finds nothing is left out as well. Precision is interpolated at 101 recalls.

use std::collections::{BTreeMap, BTreeSet};

use modulo_bags::source::GroundTruth;
use modulo_core::{BBox, Detection};

const IOU: f32 = 0.5;
/// Objects below this height, px, do not count.
const LEAST_HEIGHT: f32 = 12.0;
/// The last of KITTI's occlusion steps that is at least half visible.
const MOST_OCCLUDED: i32 = 1;
const DONT_CARE: &str = "dontcare";
/// Recalls at which COCO reads the curve: 0, 0.01, ..., 1.
const RECALLS: usize = 101;

/// One frame: what a detector said, and what is there.
pub type Scored = (Vec<Detection>, Vec<GroundTruth>);

/// AP50 of each class that has at least one object that counts, with the
/// number of these objects.
pub fn by_class(frames: &[Scored]) -> BTreeMap<String, (f64, usize)> {
    let objects = frames.iter().flat_map(|(_, truth)| truth);
    let classes: BTreeSet<&str> = objects.filter(|t| counts(t)).map(|t| t.class.as_str()).collect();
    let score = |class: &str| {
        let mut marks = Vec::new();
        let mut total = 0;
        for frame in frames {
            total += mark(frame, class, &mut marks);
        }
        (class.to_owned(), (average(marks, total), total))
    };
    classes.into_iter().map(score).collect()
}

/// The mean over classes; `None` when no object counts.
pub fn mean(by_class: &BTreeMap<String, (f64, usize)>) -> Option<f64> {
    let n = by_class.len();
    (n > 0).then(|| by_class.values().map(|(ap, _)| ap).sum::<f64>() / n as f64)
}

fn counts(truth: &GroundTruth) -> bool {
    truth.class != DONT_CARE
        && truth.bbox.y2 - truth.bbox.y1 >= LEAST_HEIGHT
        && truth.occluded <= MOST_OCCLUDED
}

/// Adds (score, whether it is right) of the detections of `class` that count;
/// returns how many objects do.
fn mark((found, truth): &Scored, class: &str, marks: &mut Vec<(f32, bool)>) -> usize {
    let of_class = truth.iter().filter(|t| t.class == class);
    let (mut objects, ignored): (Vec<&GroundTruth>, Vec<_>) = of_class.partition(|t| counts(t));
    let total = objects.len();
    let mut found: Vec<&Detection> = found.iter().filter(|d| d.class == class).collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    for detection in found {
        let overlaps = objects.iter().enumerate().map(|(i, t)| (detection.bbox.iou(t.bbox), i));
        let best = overlaps.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(iou, _)| *iou >= IOU);
        if let Some((_, index)) = best {
            objects.swap_remove(index);
            marks.push((detection.score, true));
        } else if !is_ignored(&detection.bbox, &ignored, truth) {
            marks.push((detection.score, false));
        }
    }
    total
}

fn is_ignored(bbox: &BBox, ignored: &[&GroundTruth], truth: &[GroundTruth]) -> bool {
    let within = |area: &BBox| bbox.intersection(*area) >= IOU * bbox.area();
    bbox.y2 - bbox.y1 < LEAST_HEIGHT
        || ignored.iter().any(|t| bbox.iou(t.bbox) >= IOU)
        || truth.iter().any(|t| t.class == DONT_CARE && within(&t.bbox))
}

/// COCO's average over 101 recalls of the best precision at that recall or above.
fn average(mut marks: Vec<(f32, bool)>, total: usize) -> f64 {
    marks.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut right = 0;
    let mut curve: Vec<(f64, f64)> = Vec::with_capacity(marks.len());
    for (seen, (_, is_right)) in (1u32..).zip(&marks) {
        right += u32::from(*is_right);
        curve.push((f64::from(right) / total as f64, f64::from(right) / f64::from(seen)));
    }
    let mut best: f64 = 0.0;
    for point in curve.iter_mut().rev() {
        best = best.max(point.1);
        point.1 = best;
    }
    let at = |recall: f64| curve.iter().find(|(r, _)| *r >= recall).map_or(0.0, |(_, precision)| *precision);
    (0..RECALLS).map(|i| at(i as f64 / (RECALLS - 1) as f64)).sum::<f64>() / RECALLS as f64
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
        by_class(&[(found, truth)])["car"].0
    }

    #[test]
    fn one_object_may_be_claimed_once() {
        let truth = || vec![object(0.0, 20.0, 0), object(100.0, 20.0, 0)];
        assert_eq!(ap(vec![detection(0.0, 20.0, 0.9), detection(100.0, 20.0, 0.8)], truth()), 1.0);
        // Precision 1 up to recall 0.5, that is at 51 of 101 recalls.
        let twice = ap(vec![detection(0.0, 20.0, 0.9), detection(1.0, 20.0, 0.8)], truth());
        assert!((twice - 51.0 / 101.0).abs() < 1e-12, "{twice}");
    }

    #[test]
    fn a_confident_mistake_costs_precision() {
        let found = vec![detection(50.0, 20.0, 0.9), detection(0.0, 20.0, 0.8)];
        assert_eq!(ap(found, vec![object(0.0, 20.0, 0)]), 0.5);
    }

    #[test]
    fn ignore_regions_neither_help_nor_harm() {
        let truth = || vec![object(0.0, 20.0, 0), object(100.0, 20.0, 2), object(200.0, 8.0, 0)];
        let dont_care = GroundTruth { class: DONT_CARE.into(), ..object(300.0, 60.0, -1) };
        let truth = || [truth(), vec![dont_care.clone()]].concat();
        let right = detection(0.0, 20.0, 0.5);
        for bad in [detection(100.0, 20.0, 0.9), detection(200.0, 8.0, 0.9), detection(310.0, 20.0, 0.9)] {
            assert_eq!(ap(vec![bad, right.clone()], truth()), 1.0);
        }
        assert_eq!(by_class(&[(vec![], truth())])["car"], (0.0, 1));
    }

    #[test]
    fn without_objects_there_is_no_score() {
        let scores = by_class(&[(vec![detection(0.0, 20.0, 0.9)], vec![])]);
        assert!(scores.is_empty() && mean(&scores).is_none());
    }
}
