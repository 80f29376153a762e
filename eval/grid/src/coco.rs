//! [`export`]: labels and boxes as other programs read them: COCO annotations, and COCO results of each cell.

use std::collections::BTreeMap;
use std::path::Path;

use modulo_ap::average::{Membership, image_boxes};
use modulo_ap::matching::{ImageBoxes, ObjectRole};
use modulo_core::BBox;
use serde_json::{Value, json};

use crate::GridError;
use crate::frames::FrameRecord;
use crate::score::{ScoreOptions, Scorer, scorers};
use crate::store::{Folder, replace};

/// Writes `annotations.json`, and `results/CELL.json` for each cell, into `out`. Categories are the groups in which classes are scored. What
/// is not scored is a crowd, so that a program finds the AP of the report where all objects are scored.
///
/// # Errors
/// [`GridError`] of results that cannot be read, and of a file that cannot be written.
pub fn export(folders: &[Folder], options: &ScoreOptions, out: &Path) -> Result<(), GridError> {
    let mut annotations = BTreeMap::new();
    scorers(folders, options, |point, scorer| {
        annotations.insert(point.stream.clone(), labels(scorer));
        let file = out.join("results").join(format!("{}.json", point.file_name()));
        write(&file, &Value::Array(boxes(scorer)))
    })?;
    // The cells of one camera have the same frames; those of several have files of their own.
    let mut written: Vec<Value> = Vec::new();
    for (stream, labels) in annotations {
        if !written.contains(&labels) {
            let name = if written.is_empty() {
                "annotations.json".to_owned()
            } else {
                format!("annotations-{stream}.json")
            };
            write(&out.join(name), &labels)?;
            written.push(labels);
        }
    }
    Ok(())
}

fn write(file: &Path, value: &Value) -> Result<(), GridError> {
    replace(file, format!("{value}\n").as_bytes())
}

/// The groups with their ids, from 1.
fn categories<'a>(scorer: &'a Scorer<'_>) -> Vec<(usize, &'a str)> {
    (1..).zip(scorer.groups.names()).collect()
}

/// The objects of a group in a frame.
fn objects(scorer: &Scorer<'_>, frame: usize, group: &str) -> ImageBoxes {
    let frame = &scorer.frames[frame];
    image_boxes(&[], frame.truth, scorer.difficulty, |class| scorer.groups.membership(class, group))
}

fn rectangle(b: BBox) -> [f64; 4] {
    let [x1, y1, x2, y2] = [b.x1, b.y1, b.x2, b.y2].map(f64::from);
    [x1, y1, x2 - x1, y2 - y1]
}

fn labels(scorer: &Scorer<'_>) -> Value {
    let image = |(id, frame): (usize, &crate::score::ScoredFrame<'_>)| {
        let FrameRecord { name, drive, size: [height, width], .. } = frame.record;
        json!({ "id": id, "file_name": name, "drive": drive, "height": height, "width": width })
    };
    let images: Vec<Value> = (1..).zip(&scorer.frames).map(image).collect();
    let mut annotations = Vec::new();
    for (category, group) in categories(scorer) {
        for frame in 0..scorer.frames.len() {
            for (bbox, role) in objects(scorer, frame, group).truth {
                let is_crowd = u8::from(role != ObjectRole::Counts);
                annotations.push(json!({
                    "id": annotations.len() + 1, "image_id": frame + 1, "category_id": category, "bbox": rectangle(bbox),
                    "area": rectangle(bbox)[2] * rectangle(bbox)[3], "iscrowd": is_crowd,
                }));
            }
        }
    }
    let categories: Vec<Value> =
        categories(scorer).into_iter().map(|(id, name)| json!({ "id": id, "name": name })).collect();
    json!({ "images": images, "annotations": annotations, "categories": categories })
}

fn boxes(scorer: &Scorer<'_>) -> Vec<Value> {
    let mut boxes = Vec::new();
    for (frame, found) in (1..).zip(scorer.mapped_detections()) {
        for (category, group) in categories(scorer) {
            let own =
                found.iter().filter(|one| scorer.groups.membership(&one.class, group) == Membership::Member);
            boxes.extend(own.map(|one| {
                json!({ "image_id": frame, "category_id": category, "bbox": rectangle(one.bbox), "score": one.score })
            }));
        }
    }
    boxes
}
