//! Results as text. Pure; files are written elsewhere.

use std::collections::BTreeMap;

use modulo_core::Detection;
use serde_json::{Value, json};

use crate::Score;

/// Name of a frame's image.
pub fn file_name(number: usize) -> String {
    format!("{number:06}.png")
}

/// One line a frame, so that two runs can be compared with `diff`.
pub fn boxes(frames: &[Vec<Detection>]) -> String {
    let row =
        |d: &Detection| -> Value { json!([d.bbox.x1, d.bbox.y1, d.bbox.x2, d.bbox.y2, d.score, d.class]) };
    let line = |(number, frame): (usize, &Vec<Detection>)| {
        let rows: Vec<Value> = frame.iter().map(row).collect();
        format!("  \"{}\": {}", file_name(number), Value::Array(rows))
    };
    let lines: Vec<String> = frames.iter().enumerate().map(line).collect();
    format!("{{\n{}\n}}\n", lines.join(",\n"))
}

/// `{"STREAM": {"ap50": f, "difficulty": "moderate", "classes": {"CLASS": {"ap50": f, "objects": n}}}}`
pub fn scores(scores: &BTreeMap<String, Score>) -> String {
    let class = |(ap50, objects): &(f64, usize)| json!({ "ap50": ap50, "objects": objects });
    let score = |score: &Score| {
        let classes: BTreeMap<&String, Value> = score.classes.iter().map(|(k, v)| (k, class(v))).collect();
        json!({ "ap50": score.ap50, "difficulty": score.difficulty, "classes": classes })
    };
    let all: BTreeMap<&String, Value> = scores.iter().map(|(stream, s)| (stream, score(s))).collect();
    format!("{:#}\n", json!(all))
}
