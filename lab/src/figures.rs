//! IoU, F1 and accuracy exactly as the scripts of the paper compute them.
//!
//! Detections of score >= 0.60 count; one is a true positive when any labelled box of its class has IoU >= 0.5 with it. A labelled box without
//! such a detection is a false negative: all labels but DontCare, of any size. Per image, IoU is the mean over its true positives of their
//! largest IoU (0 without any), F1 = 2PR / (P + R), accuracy = TP / (TP + FP + FN). Then the plain mean over images.
//!
//! Their weaknesses are kept: several detections may match one object, and an image without objects and without
//! detections scores 0.

use modulo_core::{BBox, Detection};

/// Lowest score of a detection that is evaluated.
const CONFIDENCE: f32 = 0.60;
const IOU: f64 = 0.5;

/// The three figures, each in [0, 1].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Paper {
    pub iou: f64,
    pub f1: f64,
    pub accuracy: f64,
}

/// The figures of one image.
pub fn of_image(found: &[Detection], truth: &[(BBox, &str)]) -> Paper {
    let found: Vec<&Detection> = found.iter().filter(|d| d.score >= CONFIDENCE).collect();
    let best = |detection: &Detection| {
        let of_class = truth.iter().filter(|(_, class)| *class == detection.class);
        of_class.map(|(bbox, _)| f64::from(detection.bbox.iou(*bbox))).fold(0.0, f64::max)
    };
    let ious: Vec<f64> = found.iter().map(|d| best(d)).filter(|iou| *iou >= IOU).collect();
    let is_found = |(bbox, class): &(BBox, &str)| {
        found.iter().any(|d| d.class == *class && f64::from(d.bbox.iou(*bbox)) >= IOU)
    };
    // True positives are counted by detections and misses by objects, so that the sum can exceed the number of objects.
    // The scripts count in this way.
    let right = ious.len() as f64;
    let wrong = (found.len() - ious.len()) as f64;
    let missed = truth.iter().filter(|object| !is_found(object)).count() as f64;
    let (precision, recall) = (share(right, right + wrong), share(right, right + missed));
    Paper {
        iou: share(ious.iter().sum(), right),
        f1: share(2.0 * precision * recall, precision + recall),
        accuracy: share(right, right + wrong + missed),
    }
}

/// The mean over images. All figures are 0 without images.
pub fn mean(images: &[Paper]) -> Paper {
    let mean = |of: fn(&Paper) -> f64| share(images.iter().map(of).sum(), images.len() as f64);
    Paper { iou: mean(|p| p.iou), f1: mean(|p| p.f1), accuracy: mean(|p| p.accuracy) }
}

fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f32) -> BBox {
        BBox { x1: x, y1: 0.0, x2: x + 10.0, y2: 10.0 }
    }

    fn car(x: f32, score: f32) -> Detection {
        Detection { bbox: square(x), score, class: "car".into() }
    }

    #[test]
    fn several_detections_may_claim_one_object() {
        // Overlap 9 of 11: IoU 0.818...; both are true positives of the one object.
        let got = of_image(&[car(0.0, 0.9), car(1.0, 0.8)], &[(square(0.0), "car")]);
        assert!((got.iou - (1.0 + 9.0 / 11.0) / 2.0).abs() < 1e-6, "{got:?}");
        assert_eq!((got.f1, got.accuracy), (1.0, 1.0));
    }

    #[test]
    fn counts_what_is_wrong_and_what_is_missed() {
        let truth = [(square(0.0), "car"), (square(100.0), "car"), (square(200.0), "van")];
        let found = [car(0.0, 0.60), car(200.0, 0.9), car(100.0, 0.59)];
        // One right, one of the wrong class, two missed: P 1/2, R 1/3.
        let got = of_image(&found, &truth);
        assert!((got.f1 - 0.4).abs() < 1e-12 && got.accuracy == 0.25 && got.iou == 1.0, "{got:?}");
    }

    #[test]
    fn an_empty_image_scores_nothing_and_the_mean_is_plain() {
        let empty = of_image(&[], &[]);
        assert_eq!(empty, Paper::default());
        let full = of_image(&[car(0.0, 0.9)], &[(square(0.0), "car")]);
        assert_eq!(mean(&[empty, full]), Paper { iou: 0.5, f1: 0.5, accuracy: 0.5 });
        assert_eq!(mean(&[]), Paper::default());
    }
}
