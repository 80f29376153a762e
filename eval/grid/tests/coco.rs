//! AP against pycocotools (`tests/peers/coco_reference.py`), on synthetic boxes.

use modulo_core::BBox;
use modulo_eval::metric::average::{ap, ap50_95, curve};
use modulo_eval::metric::matching::{ImageBoxes, ObjectRole};
use serde_json::Value;

const GOLDEN: &str = include_str!("data/coco_golden.json");

/// Reads x, y, width, height and a last number.
fn row(row: &Value) -> (BBox, f32) {
    let numbers: Vec<f32> =
        row.as_array().expect("a row").iter().map(|n| n.as_f64().expect("a number") as f32).collect();
    let [x, y, width, height, last] = numbers[..] else { panic!("five numbers: {row}") };
    (BBox { x1: x, y1: y, x2: x + width, y2: y + height }, last)
}

fn images(case: &Value) -> Vec<ImageBoxes> {
    let rows = |value: &Value| value.as_array().expect("rows").iter().map(row).collect::<Vec<_>>();
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
        let images = images(case);
        let near = |ours: Option<f64>, theirs: &Value| {
            let (ours, theirs) = (ours.expect("objects"), theirs.as_f64().expect("a number"));
            assert!((ours - theirs).abs() < 1e-6, "case {number}: {ours} against {theirs}");
        };
        near(ap(&images, 0.5), &case["ap50"]);
        near(ap50_95(&images), &case["ap50_95"]);
        let ours = curve(&images, 0.5).expect("objects");
        let theirs = case["precision50"].as_array().expect("a curve");
        assert_eq!(ours.len(), theirs.len());
        ours.iter().zip(theirs).for_each(|(ours, theirs)| near(Some(*ours), theirs));
    }
}
