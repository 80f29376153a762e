//! [`Listing`]: the results of each frame of a cell and of each of its boxes, as lines of `frames.csv` and `boxes.csv`.

use modulo_ap::average::{Membership, image_boxes};
use modulo_ap::matching::MatchOutcome;
use modulo_bags::source::GroundTruth;
use modulo_core::Detection;

use super::pipeline::{ImageSimilarity, RecoveryQuality};
use super::runner::FrameResult;
use super::score::Scorer;
use crate::labels::number;
use crate::results::{Paper, Point};
use crate::store::{CellLines, figure};

/// Least score of the boxes in `boxes.csv`. A detector gives hundreds of boxes of lower scores for each frame.
const LISTED: f32 = 0.05;
/// Least score of the boxes that `frames.csv` counts, which is that of the boxes on the images of the report.
const COUNTED: f32 = 0.25;
/// Least IoU of a box and the object that it finds.
const LEAST_IOU: f64 = 0.5;

const FRAME_HEAD: [&str; 17] = [
    "cell",
    "frame",
    "name",
    "drive",
    "answered",
    "samples",
    "wrong_k",
    "exact_k",
    "trusted",
    "method_used",
    "mse",
    "ssim",
    "mse_sharp",
    "ssim_sharp",
    "paper_iou",
    "paper_f1",
    "paper_accuracy",
];
/// Columns of each group.
const GROUP_HEAD: [&str; 4] = ["objects", "true_positives", "false_positives", "false_negatives"];
const BOX_HEAD: [&str; 11] =
    ["cell", "frame", "name", "class", "group", "score", "x1", "y1", "x2", "y2", "outcome"];

/// The lines of a cell.
pub struct Listing {
    /// A line for each frame.
    pub frames: CellLines,
    /// A line for each box.
    pub boxes: CellLines,
}

/// The boxes of a frame after matching.
struct MatchedFrame<'a> {
    /// For each group its name and the number of its scored objects.
    objects: Vec<(&'a str, usize)>,
    /// For each box its group and its outcome. `None` if it belongs to no group, or is beyond those that are scored.
    outcomes: Vec<Option<(&'a str, MatchOutcome)>>,
}

impl Scorer {
    /// The lines of the cell at `point`.
    pub fn listing(&self, point: &Point, frames: &[FrameResult]) -> Listing {
        let cell = point.to_string();
        let group = |group: &str| GROUP_HEAD.map(|column| format!("{column}_{group}"));
        let groups = self.groups.names().into_iter().flat_map(group);
        let head = FRAME_HEAD.map(str::to_owned).into_iter().chain(groups).collect();
        let mut frame_lines = CellLines { head, lines: Vec::new() };
        let mut box_lines = CellLines { head: BOX_HEAD.map(str::to_owned).to_vec(), lines: Vec::new() };
        let found = self.mapped_detections(frames);
        for (number, paper) in self.papers(&found).iter().enumerate() {
            let first = [cell.clone(), number.to_string(), self.names[number].clone()];
            let matched = self.matched(&found[number], &self.truths[number]);
            let drive = self.drives[number].clone().unwrap_or_default();
            let mut line = [first.to_vec(), vec![drive]].concat();
            line.extend(frame_figures(&frames[number], paper));
            line.extend(counts(&found[number], &matched));
            frame_lines.lines.push(line);
            let boxes =
                found[number].iter().zip(&matched.outcomes).filter(|(found, _)| found.score >= LISTED);
            box_lines.lines.extend(boxes.map(|(found, outcome)| box_line(&first, found, *outcome)));
        }
        Listing { frames: frame_lines, boxes: box_lines }
    }

    fn matched(&self, found: &[Detection], truth: &[GroundTruth]) -> MatchedFrame<'_> {
        let (mut objects, mut outcomes) = (Vec::new(), vec![None; found.len()]);
        for group in self.groups.names() {
            let membership = |class: &str| self.groups.membership(class, group);
            let image = image_boxes(found, truth, self.difficulty, membership);
            objects.push((group, image.objects()));
            // The outcomes have the indices of the boxes of the group.
            let is_member = |index: &usize| membership(&found[*index].class) == Membership::Member;
            let members: Vec<usize> = (0..found.len()).filter(is_member).collect();
            for (index, outcome) in image.outcomes(LEAST_IOU) {
                outcomes[members[index]] = Some((group, outcome));
            }
        }
        MatchedFrame { objects, outcomes }
    }
}

/// The columns from `answered` to `paper_accuracy`.
fn frame_figures(frame: &FrameResult, paper: &Paper) -> Vec<String> {
    let recovery = frame.recovery.as_ref();
    let unwrapped = recovery.filter(|recovery| recovery.samples > 0);
    let text = |of: fn(&RecoveryQuality) -> String| unwrapped.map(of).unwrap_or_default();
    let similarity = |of: fn(&RecoveryQuality) -> &ImageSimilarity| {
        let similarity = recovery.map(of);
        [
            figure(similarity.map(|similarity| similarity.mse)),
            figure(similarity.and_then(|similarity| similarity.ssim)),
        ]
    };
    let mut figures = vec![
        frame.found.is_some().to_string(),
        text(|recovery| recovery.samples.to_string()),
        text(|recovery| (recovery.samples - recovery.exact).to_string()),
        text(|recovery| figure(Some(recovery.exact_share()))),
        text(|recovery| recovery.trust.claim().map_or(String::new(), |trusted| trusted.to_string())),
        text(|recovery| recovery.method_used.clone()),
    ];
    figures.extend(similarity(|recovery| &recovery.ideal));
    figures.extend(similarity(|recovery| &recovery.sharp));
    figures.extend([paper.iou, paper.f1, paper.accuracy].map(|value| figure(Some(value))));
    figures
}

/// The columns of all groups.
fn counts(found: &[Detection], matched: &MatchedFrame<'_>) -> Vec<String> {
    let of_group = |&(group, objects): &(&str, usize)| {
        let count = |outcome| {
            let boxes = found.iter().zip(&matched.outcomes).filter(|(found, _)| found.score >= COUNTED);
            boxes.filter(|(_, other)| **other == Some((group, outcome))).count()
        };
        let right = count(MatchOutcome::Right);
        [objects, right, count(MatchOutcome::Wrong), objects - right].map(|count| count.to_string())
    };
    matched.objects.iter().flat_map(of_group).collect()
}

fn box_line(first: &[String], found: &Detection, outcome: Option<(&str, MatchOutcome)>) -> Vec<String> {
    let (group, outcome) = match outcome {
        Some((group, MatchOutcome::Right)) => (group, "true positive"),
        Some((group, MatchOutcome::Wrong)) => (group, "false positive"),
        Some((group, MatchOutcome::Ignored)) => (group, "ignored"),
        None => ("", "not scored"),
    };
    let corners = [found.bbox.x1, found.bbox.y1, found.bbox.x2, found.bbox.y2];
    let mut line = first.to_vec();
    line.extend([found.class.clone(), group.to_owned(), number(f64::from(found.score), 4)]);
    line.extend(corners.map(|corner| number(f64::from(corner), 2)));
    line.push(outcome.to_owned());
    line
}
