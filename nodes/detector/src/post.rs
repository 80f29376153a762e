//! The output of the model to detections in the original image.
//!
//! Only the parameters, better boxes of the same class and the geometry remove a box.

use modulo_core::candidates::{Candidate, suppress};
use modulo_core::{BBox, Detection, Letterbox};
use ndarray::Array2;

use crate::head::Head;
use crate::parameter::{DetectorParameters, Settings};

/// Returns the boxes of an `output` of the form `head` that are worth publishing: score of at least the threshold, a class that is published,
/// an area inside the image, and no better box of the same class in the same place; best first, at most `max_det`.
pub fn detections(
    output: &Array2<f32>,
    head: Head,
    letterbox: &Letterbox,
    settings: &Settings,
) -> Vec<Detection> {
    let &DetectorParameters { score_threshold, max_det, nms_iou, .. } = &settings.parameters;
    let mut candidates = head.candidates(output, score_threshold as f32);
    if let Some(classes) = head.classes_to_suppress() {
        let is_published: Vec<_> =
            (0..classes).map(|class| settings.classes.publish(class).is_some()).collect();
        candidates.retain(|one| is_published[one.class]);
        candidates = suppress(candidates, nms_iou as f32, max_det);
    }
    let mut found: Vec<_> = candidates.iter().filter_map(|one| detection(one, letterbox, settings)).collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    found.truncate(max_det);
    found
}

fn detection(one: &Candidate, letterbox: &Letterbox, settings: &Settings) -> Option<Detection> {
    let bbox = letterbox.inverse(one.bbox);
    if bbox.x2 <= bbox.x1 || bbox.y2 <= bbox.y1 {
        return None;
    }
    let class = settings.classes.publish(one.class)?;
    Some(Detection { bbox, score: one.score.min(1.0), class })
}

/// Returns whether no box is larger than a pixel of the input of the model, as where a model gives shares of its input.
pub fn are_shares(found: &[Detection], letterbox: &Letterbox) -> bool {
    let (vertical, horizontal) = letterbox.scale();
    let is_share =
        |BBox { x1, y1, x2, y2 }: BBox| (x2 - x1) * horizontal <= 1.0 && (y2 - y1) * vertical <= 1.0;
    !found.is_empty() && found.iter().all(|one| is_share(one.bbox))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use modulo_runtime::ParameterSet as _;
    use proptest::prelude::*;

    use super::*;
    use crate::classes::ClassMap;
    use crate::input_size::STRIDE;
    use crate::model::ModelLayout;
    use crate::names::ClassNames;

    fn settings(changes: &[(&str, &str)]) -> Settings {
        let names = Some("{0: 'person', 1: 'bicycle', 2: 'car'}");
        let names = ClassNames::of(Path::new("none"), names).expect("names");
        let layout = ModelLayout {
            input: "images".into(),
            output: "output0".into(),
            size: None,
            stride: STRIDE,
            names,
            end_to_end: None,
        };
        let parameters = DetectorParameters::from_text(changes).expect("possible");
        Settings::new(&parameters, &layout, ClassMap::default()).expect("readable")
    }

    fn found(rows: &[[f32; 6]], changes: &[(&str, &str)]) -> Vec<Detection> {
        found_in(Array2::from(rows.to_vec()), Head::EndToEnd, changes)
    }

    fn found_in(output: Array2<f32>, head: Head, changes: &[(&str, &str)]) -> Vec<Detection> {
        let settings = settings(changes);
        let letterbox = settings.input_size.place(100, 200).expect("placed");
        detections(&output, head, &letterbox, &settings)
    }

    #[test]
    fn best_first_and_the_rest_is_dropped() {
        let good = [10.0, 20.0, 30.0, 40.0, 0.5, 2.0];
        let rows = [
            good,
            [10.0, 20.0, 30.0, 40.0, 0.9, 7.0],
            [10.0, 20.0, 30.0, 40.0, 0.24, 0.0],
            [10.0, 20.0, 30.0, 40.0, f32::NAN, 0.0],
            [f32::NAN, 20.0, 30.0, 40.0, 0.8, 0.0],
            [10.0, 20.0, f32::INFINITY, 40.0, 0.8, 0.0],
            [30.0, 20.0, 10.0, 40.0, 0.8, 0.0],
            [201.0, 20.0, 240.0, 40.0, 0.8, 0.0],
            [10.0, 20.0, 30.0, 40.0, 0.8, -1.0],
            [10.0, 20.0, 30.0, 40.0, 0.8, f32::NAN],
        ];
        let all = found(&rows, &[]);
        let pairs: Vec<_> = all.iter().map(|one| (one.class.as_str(), one.score)).collect();
        assert_eq!(pairs, [("7", 0.9), ("car", 0.5)]);
        assert_eq!(all[1].bbox, BBox { x1: 10.0, y1: 20.0, x2: 30.0, y2: 40.0 });
        assert_eq!(found(&rows, &[("max_det", "1")]).len(), 1);
        assert_eq!(found(&rows, &[("classes", "car")]).len(), 1);
        assert_eq!(found(&rows, &[("score_threshold", "0.95")]), []);
        assert_eq!(found(&[good], &[("score_threshold", "0.5")]).len(), 1, "the threshold itself counts");
    }

    #[test]
    fn boxes_come_back_to_the_image() {
        // 200 x 100 into 64 x 64: scale 0.32, 16 rows of padding above.
        let all = found(&[[32.0, 32.0, 64.0, 64.0, 0.5, 2.0]], &[("input_size", "64x64")]);
        assert_eq!(all[0].bbox, BBox { x1: 100.0, y1: 50.0, x2: 200.0, y2: 100.0 });
    }

    #[test]
    fn boxes_below_a_pixel_of_the_input_are_shares() {
        let settings = settings(&[("input_size", "64x64")]);
        let letterbox = settings.input_size.place(100, 200).expect("placed");
        let of = |rows: &[[f32; 6]]| {
            let found = detections(&Array2::from(rows.to_vec()), Head::EndToEnd, &letterbox, &settings);
            (found.len(), are_shares(&found, &letterbox))
        };
        // A pixel of the input is 3.1 px of the image, of which the input has the rows 16 to 47.
        let (share, pixels) = ([20.0, 20.0, 20.9, 20.9, 0.9, 0.0], [20.0, 20.0, 22.0, 20.5, 0.9, 0.0]);
        assert_eq!((of(&[share, share]), of(&[share, pixels]), of(&[])), ((2, true), (2, false), (0, false)));
    }

    proptest! {
        #[test]
        fn whatever_a_model_says_boxes_lie_in_the_image(
            rows in prop::collection::vec(prop::array::uniform6(prop_oneof![any::<f32>(), -10f32..300.0]), 0..20)
        ) {
            let all = found(&rows, &[("score_threshold", "0")]);
            prop_assert!(all.windows(2).all(|pair| pair[0].score >= pair[1].score));
            for Detection { bbox, score, .. } in all {
                prop_assert!(0.0 <= bbox.x1 && bbox.x1 < bbox.x2 && bbox.x2 <= 200.0);
                prop_assert!(0.0 <= bbox.y1 && bbox.y1 < bbox.y2 && bbox.y2 <= 100.0);
                prop_assert!((0.0..=1.0).contains(&score));
            }
        }
    }
}
