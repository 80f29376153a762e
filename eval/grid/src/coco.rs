//! [`export`]: labels and boxes as other programs read them: COCO annotations, and COCO results of each cell.

use std::collections::BTreeMap;
use std::path::Path;

use modulo_ap::matching::{ImageBoxes, ObjectRole};
use modulo_core::BBox;
use serde_json::{Value, json};

use crate::GridError;
use crate::frames::FrameRecord;
use crate::score::{Rules, ScoreOptions, ScoredFrame, Scorer};
use crate::store::{Folder, replace};
use crate::stored::Stored;

/// Writes `annotations.json`, and `results/CELL.json` for each cell, into `out`. Categories are the groups in which classes are scored. What
/// is not scored is a crowd, so that a program finds the AP of the report where all objects are scored.
///
/// # Errors
/// [`GridError`] of results that cannot be read, and of a file that cannot be written.
pub fn export(folders: &[Folder], options: &ScoreOptions, out: &Path) -> Result<(), GridError> {
    let mut annotations = BTreeMap::new();
    let stored = Stored::read(folders)?;
    Rules::new(&stored, options)?.score(&stored, |scorer| {
        let (point, categories) = (&scorer.cell.key.point, categories(scorer));
        annotations.insert(point.stream.clone(), labels(scorer, &categories));
        let file = out.join("results").join(format!("{}.json", point.file_name()));
        write(&file, &Value::Array(boxes(scorer.frames.len(), &categories)))
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

/// A group with its id, from 1, and its boxes in each frame.
type Category<'a> = (usize, &'a str, Vec<ImageBoxes>);

fn categories<'a>(scorer: &'a Scorer<'_>) -> Vec<Category<'a>> {
    let found = scorer.mapped_detections();
    let images = |group| scorer.of_group(&found, group, scorer.rules.difficulty);
    (1..).zip(scorer.rules.groups.names()).map(|(id, group)| (id, group, images(group))).collect()
}

fn rectangle(b: BBox) -> [f64; 4] {
    let [x1, y1, x2, y2] = [b.x1, b.y1, b.x2, b.y2].map(f64::from);
    [x1, y1, x2 - x1, y2 - y1]
}

fn labels(scorer: &Scorer<'_>, categories: &[Category<'_>]) -> Value {
    let image = |(id, frame): (usize, &ScoredFrame<'_>)| {
        let FrameRecord { name, drive, size: [height, width], .. } = frame.record;
        json!({ "id": id, "file_name": name, "drive": drive, "height": height, "width": width })
    };
    let images: Vec<Value> = (1..).zip(&scorer.frames).map(image).collect();
    let mut annotations = Vec::new();
    for (category, _, frames) in categories {
        for (frame, (bbox, role)) in
            (1..).zip(frames).flat_map(|(id, image)| image.truth.iter().map(move |one| (id, *one)))
        {
            let is_crowd = u8::from(role != ObjectRole::Counts);
            annotations.push(json!({
                "id": annotations.len() + 1, "image_id": frame, "category_id": category, "bbox": rectangle(bbox),
                "area": rectangle(bbox)[2] * rectangle(bbox)[3], "iscrowd": is_crowd,
            }));
        }
    }
    let categories = categories.iter().map(|(id, name, _)| json!({ "id": id, "name": name }));
    json!({ "images": images, "annotations": annotations, "categories": categories.collect::<Vec<_>>() })
}

fn boxes(frames: usize, categories: &[Category<'_>]) -> Vec<Value> {
    let mut boxes = Vec::new();
    for frame in 0..frames {
        for (category, _, images) in categories {
            boxes.extend(images[frame].found.iter().map(|(bbox, score)| {
                json!({ "image_id": frame + 1, "category_id": category, "bbox": rectangle(*bbox), "score": score })
            }));
        }
    }
    boxes
}
