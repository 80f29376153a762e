//! The objects of a frame of an evaluation, and which of them were found: the nearest one, or all.

use std::collections::BTreeMap;
use std::path::PathBuf;

use modulo_core::BBox;
use serde_json::Value;

/// Least score of the boxes that are counted.
pub const COUNTED: f64 = 0.25;
/// Least IoU of a box and the object that it finds.
const LEAST_IOU: f32 = 0.5;

/// Returns the frames of the files by their places in the evaluation. The number of a frame in its drive is added.
pub fn frames_of(files: &[(PathBuf, Value)]) -> BTreeMap<u64, Value> {
    let all = files.iter().flat_map(|(_, file)| file["frames"].as_array().into_iter().flatten());
    let mut frames: BTreeMap<u64, Value> =
        all.filter_map(|frame| Some((frame["place"].as_u64()?, frame.clone()))).collect();
    let mut numbers: BTreeMap<String, u64> = BTreeMap::new();
    for frame in frames.values_mut() {
        let number = numbers.entry(frame["drive"].to_string()).or_default();
        frame["number"] = (*number).into();
        *number += 1;
    }
    frames
}

/// Returns the change that is nearest to a frame, and the frames since it; `None` where no change is within half of the
/// time between two.
pub fn change_of(frame: &Value) -> Option<(&'static str, i64)> {
    let (drive, number) = (frame["drive"].as_str()?, frame["number"].as_i64()?);
    let length = [("light=tunnels", 50), ("light=trees", 12)];
    let (_, length) = length.into_iter().find(|(light, _)| drive.contains(light))?;
    let (turn, within) = (number / length, number % length);
    let is_before = within >= length / 2;
    let (turn, since) = if is_before { (turn + 1, within - length) } else { (turn, within) };
    (turn > 0).then_some((if turn % 2 == 1 { "darker" } else { "brighter" }, since))
}

/// Returns whether the highest object that counts at difficulty moderate was found; `None` without one.
pub fn is_nearest_found(frame: &Value, found: &Value) -> Option<bool> {
    let nearest = objects(frame).max_by(|a, b| height(a.0).total_cmp(&height(b.0)))?;
    Some(is_found(nearest, found))
}

/// Returns how many of the objects that count were found.
pub fn objects_found(frame: &Value, found: &Value) -> usize {
    objects(frame).filter(|object| is_found(*object, found)).count()
}

/// Returns the objects that count at difficulty moderate.
fn objects(frame: &Value) -> impl Iterator<Item = (BBox, &'static str)> {
    let label = |label: &Value| {
        let (bbox, group) = (crate::bbox(&label[0])?, group(label[1].as_str()?)?);
        let counts = label[2].as_f64()? <= 0.3 && label[3].as_i64()? <= 1 && height(bbox) >= 25.0;
        counts.then_some((bbox, group))
    };
    frame["truth"].as_array().into_iter().flatten().filter_map(label)
}

fn is_found((object, class): (BBox, &str), found: &Value) -> bool {
    let is_hit = |row: &Value| {
        row[2].as_str().and_then(group) == Some(class)
            && row[1].as_f64().is_some_and(|score| score >= COUNTED)
            && crate::bbox(&row[0]).is_some_and(|bbox| bbox.iou(object) >= LEAST_IOU)
    };
    found["boxes"].as_array().into_iter().flatten().any(is_hit)
}

fn group(class: &str) -> Option<&'static str> {
    match class {
        "car" | "van" | "truck" | "bus" | "train" | "tram" => Some("vehicle"),
        "pedestrian" | "person" | "person_sitting" => Some("person"),
        _ => None,
    }
}

fn height(bbox: BBox) -> f32 {
    bbox.y2 - bbox.y1
}

/// Returns the share of the frames with an object whose object is found; `None` without one.
pub fn share(found: &[Option<bool>]) -> Option<f64> {
    let scored: Vec<bool> = found.iter().flatten().copied().collect();
    let hits = scored.iter().filter(|is_found| **is_found).count();
    (!scored.is_empty()).then(|| hits as f64 / scored.len() as f64)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn the_nearest_change_is_before_or_after_a_frame() {
        let change =
            |number: i64| change_of(&json!({"drive": "scene://day?light=tunnels", "number": number}));
        let darker = |since| Some(("darker", since));
        assert_eq!(
            [10, 44, 50, 74, 80, 100].map(change),
            [None, darker(-6), darker(0), darker(24), Some(("brighter", -20)), Some(("brighter", 0))]
        );
        assert_eq!(change_of(&json!({"drive": "scene://day", "number": 50})), None);
    }

    #[test]
    fn the_highest_object_that_counts_is_the_nearest() {
        let frame = json!({"truth": [
            [[0, 0, 10, 90], "car", 0.5, 0], // Cut off by the border.
            [[20, 0, 60, 30], "car", 0.0, 0],
            [[20, 0, 60, 80], "cyclist", 0.0, 0],
        ]});
        let found = |score: f64, class: &str| json!({"boxes": [[[20, 0, 60, 29], score, class]]});
        let is_found = |score, class| is_nearest_found(&frame, &found(score, class));
        assert_eq!(is_found(0.9, "van"), Some(true));
        assert_eq!((is_found(0.2, "van"), is_found(0.9, "person")), (Some(false), Some(false)));
        assert_eq!(is_nearest_found(&json!({"truth": []}), &json!({})), None);
        assert_eq!((objects_found(&frame, &found(0.9, "van")), objects_found(&frame, &json!({}))), (1, 0));
    }
}
