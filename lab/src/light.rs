//! The nearest object around a change of the light: in which share of the frames is it found, before and after each change?

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Parser;
use modulo_core::BBox;
use modulo_lab::{bbox, jsons, percent};
use serde_json::Value;

/// The frames before a change, and those after it, that are looked at.
const BEFORE: i64 = 6;
const AFTER: i64 = 24;
/// The number of frames of a moment: one alone has too few objects.
const LENGTH: i64 = 2;
/// Least score of the boxes that are counted.
const COUNTED: f64 = 0.25;
/// Least IoU of a box and the object that it finds.
const LEAST_IOU: f32 = 0.5;

/// Prints the share of the frames whose nearest object is found: of all frames, and by the frames since a change of the light
#[derive(Parser)]
struct Options {
    /// Folder of the results of `modulo eval` for sources with `light=`
    results: PathBuf,
}

fn main() -> anyhow::Result<()> {
    let Options { results } = Options::parse();
    let frames = frames_of(&jsons(&results.join("frames"))?);
    let mut cells: BTreeMap<String, Vec<(&Value, Option<bool>)>> = BTreeMap::new();
    for (_, cell) in jsons(&results.join("cells"))? {
        let shown = cells.entry(cell["key"]["point"].to_string()).or_default();
        for found in cell["frames"].as_array().into_iter().flatten() {
            let frame = frames.get(&found["place"].as_u64().unwrap_or(u64::MAX));
            shown.extend(frame.map(|frame| (frame, is_nearest_found(frame, found))));
        }
    }
    println!("stream,gains,exposure_delay,change,frame,frames,nearest");
    for (point, found) in &cells {
        let point: Value = serde_json::from_str(point)?;
        let name = ["stream", "gains", "exposure_delay"].map(|key| point[key].to_string().replace('"', ""));
        let print = |change: &str, frame: i64, found: &[Option<bool>]| {
            let nearest = percent(share(found));
            println!("{},{change},{frame},{},{nearest}", name.join(","), found.len());
        };
        print("all", 0, &found.iter().map(|(_, is_found)| *is_found).collect::<Vec<_>>());
        for change in ["darker", "brighter"] {
            for moment in (-BEFORE..AFTER).step_by(LENGTH as usize) {
                let is_here = |frame: &Value| {
                    change_of(frame).is_some_and(|(of_frame, since)| {
                        of_frame == change && (moment..moment + LENGTH).contains(&since)
                    })
                };
                let here = found.iter().filter(|(frame, _)| is_here(frame));
                let here: Vec<Option<bool>> = here.map(|(_, is_found)| *is_found).collect();
                if !here.is_empty() {
                    print(change, moment, &here);
                }
            }
        }
    }
    Ok(())
}

/// Returns the frames of the files by their places in the evaluation. The number of a frame in its drive is added.
fn frames_of(files: &[(PathBuf, Value)]) -> BTreeMap<u64, Value> {
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

/// Returns the change that is nearest to a frame, and the frames since it; `None` where no change is within half of the time between two.
fn change_of(frame: &Value) -> Option<(&'static str, i64)> {
    let (drive, number) = (frame["drive"].as_str()?, frame["number"].as_i64()?);
    let length = [("light=tunnels", 50), ("light=trees", 12)];
    let (_, length) = length.into_iter().find(|(light, _)| drive.contains(light))?;
    let (turn, within) = (number / length, number % length);
    let is_before = within >= length / 2;
    let (turn, since) = if is_before { (turn + 1, within - length) } else { (turn, within) };
    (turn > 0).then_some((if turn % 2 == 1 { "darker" } else { "brighter" }, since))
}

/// Returns whether the highest object that counts at difficulty moderate was found; `None` without one.
fn is_nearest_found(frame: &Value, found: &Value) -> Option<bool> {
    let label = |label: &Value| {
        let (bbox, group) = (bbox(&label[0])?, group(label[1].as_str()?)?);
        let counts = label[2].as_f64()? <= 0.3 && label[3].as_i64()? <= 1 && height(bbox) >= 25.0;
        counts.then_some((bbox, group))
    };
    let objects = frame["truth"].as_array()?.iter().filter_map(label);
    let (nearest, class) = objects.max_by(|a, b| height(a.0).total_cmp(&height(b.0)))?;
    let is_hit = |row: &Value| {
        let is_same = row[2].as_str().and_then(group) == Some(class);
        is_same
            && row[1].as_f64().is_some_and(|score| score >= COUNTED)
            && bbox(&row[0]).is_some_and(|bbox| bbox.iou(nearest) >= LEAST_IOU)
    };
    Some(found["boxes"].as_array().into_iter().flatten().any(is_hit))
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

fn share(found: &[Option<bool>]) -> Option<f64> {
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
        let found = |score: f64, class: &str| {
            is_nearest_found(&frame, &json!({"boxes": [[[20, 0, 60, 29], score, class]]}))
        };
        assert_eq!(found(0.9, "van"), Some(true));
        assert_eq!((found(0.2, "van"), found(0.9, "person")), (Some(false), Some(false)));
        assert_eq!(is_nearest_found(&json!({"truth": []}), &json!({})), None);
    }
}
