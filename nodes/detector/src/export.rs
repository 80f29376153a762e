//! [`ClassNumbers`]: boxes as the files of other programs have them, YOLO's lines of text and COCO's results.

use std::collections::HashMap;
use std::fmt::Write as _;

use modulo_core::Detection;
use serde_json::{Value, json};

use crate::classes::Classes;

/// Number of the classes of COCO.
const COCO: usize = 80;
/// The numbers up to 90 that are no category of COCO.
const GAPS: [usize; 10] = [12, 26, 29, 30, 45, 66, 68, 69, 71, 83];

/// The numbers of the classes of a model. A name that a class map gives to several classes has the least number of them.
pub struct ClassNumbers {
    numbers: HashMap<String, usize>,
    /// Whether the model has the classes of COCO, whose categories have numbers of their own.
    is_coco: bool,
}

impl ClassNumbers {
    pub(crate) fn of(classes: &Classes) -> Self {
        let names = classes.names();
        let is_coco =
            names.count() == COCO && names.name(0) == "person" && names.name(COCO - 1) == "toothbrush";
        Self { numbers: classes.numbers(), is_coco }
    }

    /// Returns the number of a class in the model. Classes without names are called by it.
    fn number(&self, class: &str) -> usize {
        let known = self.numbers.get(class).copied();
        known.or_else(|| class.parse().ok()).expect("a class has a name or is called by its number")
    }

    /// Returns a line `class x y width height` for each detection, with its score behind it on request: the number of the class in the model,
    /// and the centre and the size of the box as shares of an image of (height, width), as `save_txt` and `save_conf` of ultralytics write them.
    pub fn yolo(&self, found: &[Detection], (height, width): (usize, usize), scores: bool) -> String {
        let (height, width) = (height as f32, width as f32);
        let mut lines = String::new();
        for Detection { bbox, score, class } in found {
            let (x, y) = ((bbox.x1 + bbox.x2) / 2.0 / width, (bbox.y1 + bbox.y2) / 2.0 / height);
            let (w, h) = ((bbox.x2 - bbox.x1) / width, (bbox.y2 - bbox.y1) / height);
            let score = if scores { format!(" {score:.6}") } else { String::new() };
            writeln!(lines, "{} {x:.6} {y:.6} {w:.6} {h:.6}{score}", self.number(class))
                .expect("a text takes any text");
        }
        lines
    }

    /// Returns the entry of each detection in a file of COCO results. The category of a model with the 80 classes of COCO is COCO's, that of
    /// any other one the number of the class, counted from 1, as ultralytics has it.
    pub fn coco(&self, found: &[Detection], image_id: &Value, file_name: &str) -> Vec<Value> {
        let category = |class: &str| {
            let number = self.number(class) + 1;
            if self.is_coco {
                (1..=90).filter(|id| !GAPS.contains(id)).nth(number - 1).unwrap_or(number)
            } else {
                number
            }
        };
        let rounded = |value: f32, unit: f64| (f64::from(value) * unit).round() / unit;
        let entry = |Detection { bbox, score, class }: &Detection| {
            let [x, y, w, h] =
                [bbox.x1, bbox.y1, bbox.x2 - bbox.x1, bbox.y2 - bbox.y1].map(|v| rounded(v, 1e3));
            json!({
                "image_id": image_id, "file_name": file_name, "category_id": category(class), "category_name": class,
                "bbox": [x, y, w, h], "score": rounded(*score, 1e5),
            })
        };
        found.iter().map(entry).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use modulo_core::BBox;

    use super::*;
    use crate::classes::ClassMap;
    use crate::names::ClassNames;

    fn numbers(names: &[&str], map: &str) -> ClassNumbers {
        let names = (!names.is_empty()).then(|| format!("{names:?}"));
        let names = ClassNames::of(Path::new("none"), names.as_deref()).expect("names");
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(&file, map).expect("writable");
        let path = if map.is_empty() { "" } else { file.path().to_str().expect("UTF-8") };
        let map = ClassMap::read(path, &names).expect("readable");
        ClassNumbers::of(&Classes::new(&names, map, &[]).expect("possible"))
    }

    fn found(class: &str) -> Vec<Detection> {
        let bbox = BBox { x1: 10.0, y1: 20.0, x2: 30.5, y2: 60.0 };
        vec![Detection { bbox, score: 0.123_456_7, class: class.to_owned() }]
    }

    #[test]
    fn a_class_has_its_number_whatever_it_is_called() {
        let three = ["person", "bicycle", "car"];
        for (names, map, class, number) in [
            (&three[..], "", "car", 2),
            (&three, "car: vehicle\nbicycle: vehicle", "vehicle", 1),
            (&three, "", "7", 7),
            (&[], "", "5", 5),
            (&[], "4: lorry", "lorry", 4),
        ] {
            let numbers = numbers(names, map);
            let expected = format!("{number} 0.202500 0.400000 0.205000 0.400000");
            assert_eq!(numbers.yolo(&found(class), (100, 100), false), format!("{expected}\n"));
            assert_eq!(numbers.yolo(&found(class), (100, 100), true), format!("{expected} 0.123457\n"));
            assert_eq!(numbers.coco(&found(class), &7.into(), "a.png")[0]["category_id"], number + 1);
        }
    }

    /// The numbers of COCO's categories have gaps, the last one is 90.
    #[test]
    fn a_model_of_coco_has_its_categories() {
        let mut names: Vec<String> = (0..COCO).map(|class| format!("class {class}")).collect();
        (names[0], names[11], names[79]) = ("person".into(), "stop sign".into(), "toothbrush".into());
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let numbers = numbers(&names, "");
        for (class, id) in [("person", 1), ("stop sign", 13), ("class 10", 11), ("toothbrush", 90)] {
            let entry = &numbers.coco(&found(class), &7.into(), "a.png")[0];
            assert_eq!(entry["category_id"], id, "{class}");
            assert_eq!(entry["bbox"], json!([10.0, 20.0, 20.5, 40.0]));
        }
    }
}
