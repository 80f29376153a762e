//! Whether the output of a first run can be boxes in pixels at all, whatever the model has learned.

use ndarray::{Array2, ArrayView1, s};

use crate::head::Head;
use crate::names::MOST_CLASS;

/// Boxes that are shares of the input have no coordinate above this. Not all boxes in pixels are as small.
const MOST_SHARE: f32 = 1.5;
/// An input of this side, px, is larger than a box of the finest anchors can be.
const LARGE: usize = 320;

/// What to do with a model whose output cannot be boxes.
pub const EXPORT: &str = "export it with 'yolo export model=FILE.pt format=onnx', or change its last layers";
const RAW: &str = "if the columns are centre, size, objectness and the score of one class, as those of YOLOv5, set the metadata \
                   property end2end to False";

type Row<'a> = ArrayView1<'a, f32>;
/// What most rows must not be, its description and the remedy.
type Fault = (fn(&Row<'_>) -> bool, &'static str, &'static str);

const NO_NUMBERS: Fault =
    (|row| row.iter().any(|value| !value.is_finite()), "have values that are no finite numbers", EXPORT);
const END_TO_END: [Fault; 3] = [
    NO_NUMBERS,
    (|row| !is_class(row[5]), "have a class that is no whole number", RAW),
    (|row| row[2] < row[0] || row[3] < row[1], "have x2 < x1 or y2 < y1", RAW),
];
const RAW_HEAD: [Fault; 2] =
    [NO_NUMBERS, (|row| row[2] < 0.0 || row[3] < 0.0, "have a negative width or height", EXPORT)];

/// Returns why the `output` of a run on an image of (height, width) cannot be what `head` says, and what to do. An output without any box
/// says nothing.
pub fn contradiction(head: Head, output: &Array2<f32>, (height, width): (usize, usize)) -> Option<String> {
    let all = head.by_box(output);
    // A model that removes overlaps itself fills up its rows, and their scores are 0.
    let is_box = |row: &Row<'_>| !(head == Head::EndToEnd && row[4] <= 0.0);
    let rows: Vec<_> = all.rows().into_iter().filter(is_box).collect();
    let faults = if head == Head::EndToEnd { &END_TO_END[..] } else { &RAW_HEAD };
    for (is_wrong, what, remedy) in faults {
        let wrong = rows.iter().filter(|row| is_wrong(row)).count();
        if 2 * wrong > rows.len() {
            return Some(format!("{wrong} of {} boxes {what}; {remedy}", rows.len()));
        }
    }
    let end = if head == Head::EndToEnd { 5 } else { all.ncols() };
    let scores = || rows.iter().flat_map(|row| row.slice(s![4..end]).to_vec());
    if let Some(score) = scores().find(|score| score.is_finite() && !(-0.01..=1.01).contains(score)) {
        return Some(format!("a score is {score}, and scores lie between 0 and 1; {EXPORT}"));
    }
    let all_are = |what: fn(&Row<'_>) -> bool| !rows.is_empty() && rows.iter().all(what);
    if all_are(|row| row.iter().take(4).all(|side| side.abs() <= MOST_SHARE)) {
        return Some(format!(
            "all boxes lie between 0 and 1, as shares of the input, and pixels are needed; {EXPORT}"
        ));
    }
    let is_large = height.min(width) >= LARGE && rows.len() > LARGE;
    if head != Head::EndToEnd && is_large && all_are(|row| row[2] >= row[0] && row[3] >= row[1]) {
        return Some(format!(
            "all boxes seem to be x1, y1, x2, y2, and centre and size are needed; {EXPORT}"
        ));
    }
    None
}

fn is_class(value: f32) -> bool {
    (value - value.round()).abs() < 1e-3 && (0.0..=MOST_CLASS as f32).contains(&value.round())
}

/// Returns a warning where an end-to-end `output` has classes beyond the names of a model that has names.
pub fn unnamed_classes(head: Head, output: &Array2<f32>, named: usize) -> Option<String> {
    let rows = output.rows().into_iter().filter(|row| head == Head::EndToEnd && row[4] > 0.0);
    let most = rows.map(|row| row[5]).fold(0.0, f32::max);
    (named > 0 && most >= named as f32).then(|| {
        format!("has names of {named} classes and finds class {most}: a class without a name is called by its number")
    })
}
