//! Rows of the model to detections in the original image.
//!
//! Only the parameters and the geometry remove a row.

use modulo_core::{BBox, Detection, Letterbox};
use ndarray::{Array2, ArrayView1};

use crate::parameter::Settings;

/// Largest valid class index.
const MOST_CLASSES: f32 = 65_535.0;

/// Returns the rows (N x 6: x1, y1, x2, y2 in input px, score, class) that are worth publishing: score of at least the
/// threshold, a class that is published and a box with an area inside the image; best first, at most `max_det`.
pub fn detections(rows: &Array2<f32>, letterbox: &Letterbox, settings: &Settings) -> Vec<Detection> {
    let mut found: Vec<_> =
        rows.rows().into_iter().filter_map(|row| detection(row, letterbox, settings)).collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    found.truncate(settings.max_det);
    found
}

fn detection(row: ArrayView1<'_, f32>, letterbox: &Letterbox, settings: &Settings) -> Option<Detection> {
    let &[x1, y1, x2, y2, score, class] = row.as_slice()? else { return None };
    if ![x1, y1, x2, y2, score].iter().all(|value| value.is_finite()) || score < settings.score_threshold {
        return None;
    }
    let class = Some(class.round()).filter(|class| (0.0..=MOST_CLASSES).contains(class))?;
    let bbox = letterbox.inverse(BBox { x1, y1, x2, y2 });
    if bbox.x2 <= bbox.x1 || bbox.y2 <= bbox.y1 {
        return None;
    }
    let class = settings.classes.publish(class as usize)?;
    Some(Detection { bbox, score: score.min(1.0), class })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use modulo_runtime::ParameterSet as _;
    use proptest::prelude::*;

    use super::*;
    use crate::classes::ClassMap;
    use crate::model::{ClassNames, ModelLayout};
    use crate::parameter::DetectorParameters;

    fn settings(changes: &[(&str, &str)]) -> Settings {
        let names = Some("{0: 'person', 1: 'bicycle', 2: 'car'}");
        let names = ClassNames::of(Path::new("none"), names).expect("names");
        let layout = ModelLayout { input: "images".into(), output: "output0".into(), size: None, names };
        let parameters = DetectorParameters::from_text(changes).expect("possible");
        Settings::new(&parameters, &layout, ClassMap::default()).expect("readable")
    }

    fn found(rows: &[[f32; 6]], changes: &[(&str, &str)]) -> Vec<Detection> {
        let settings = settings(changes);
        let letterbox = settings.input_size.place(100, 200).expect("placed");
        detections(&Array2::from(rows.to_vec()), &letterbox, &settings)
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
