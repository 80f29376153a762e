//! The frames of a cell as JSON lines: each with its figures and its boxes.

use std::collections::BTreeMap;

use modulo_ap::average::{Membership, image_boxes};
use modulo_ap::matching::MatchOutcome;
use modulo_bags::source::GroundTruth;
use modulo_core::Detection;
use serde::Serialize;

use super::pipeline::RecoveryQuality;
use super::runner::FrameResult;
use super::score::Scorer;
use crate::results::Paper;

/// Least score of the boxes that are listed. A detector gives hundreds of boxes of lower scores for each frame.
const LISTED: f32 = 0.05;
/// Least score of the boxes that are counted, which is that of the boxes on the images of the report.
pub(super) const COUNTED: f32 = 0.25;
/// Least IoU of a box and the object that it finds.
pub(super) const LEAST_IOU: f64 = 0.5;

#[derive(Serialize)]
struct FrameLine<'a> {
    frame: usize,
    name: &'a str,
    drive: Option<&'a str>,
    answered: bool,
    recovery: Option<&'a RecoveryQuality>,
    paper: Paper,
    groups: BTreeMap<&'a str, Counts>,
    boxes: Vec<BoxLine<'a>>,
}

/// Scored objects of a group, and boxes of a score of at least [`COUNTED`].
#[derive(Default, Serialize)]
struct Counts {
    objects: usize,
    true_positives: usize,
    false_positives: usize,
    false_negatives: usize,
}

#[derive(Serialize)]
struct BoxLine<'a> {
    class: &'a str,
    group: Option<&'a str>,
    score: f32,
    corners: [f32; 4],
    outcome: &'static str,
}

impl Scorer {
    /// The lines of a cell.
    pub fn listing(&self, frames: &[FrameResult]) -> Vec<u8> {
        let found = self.mapped_detections(frames);
        let mut lines = Vec::new();
        for (frame, paper) in self.papers(&found).into_iter().enumerate() {
            let (groups, boxes) = self.matched(&found[frame], &self.frames[frame].truth);
            let line = FrameLine {
                frame,
                name: &self.frames[frame].name,
                drive: self.frames[frame].drive.as_deref(),
                answered: frames[frame].found.is_some(),
                recovery: frames[frame].recovery.as_ref(),
                paper,
                groups,
                boxes: boxes.into_iter().filter(|found| found.score >= LISTED).collect(),
            };
            serde_json::to_writer(&mut lines, &line).expect("memory takes numbers and text");
            lines.push(b'\n');
        }
        lines
    }

    /// The counts of each group, and all boxes.
    fn matched<'a>(
        &'a self,
        found: &'a [Detection],
        truth: &[GroundTruth],
    ) -> (BTreeMap<&'a str, Counts>, Vec<BoxLine<'a>>) {
        let mut boxes: Vec<BoxLine<'a>> = found.iter().map(BoxLine::of).collect();
        let count = |group: &'a str| {
            let membership = |class: &str| self.groups.membership(class, group);
            let image = image_boxes(found, truth, self.difficulty, membership);
            let mut counts = Counts { objects: image.objects(), ..Counts::default() };
            // The outcomes have the indices of the boxes of the group.
            let is_member = |index: &usize| membership(&found[*index].class) == Membership::Member;
            let members: Vec<usize> = (0..found.len()).filter(is_member).collect();
            for (index, outcome) in image.outcomes(LEAST_IOU) {
                let one = &mut boxes[members[index]];
                one.group = Some(group);
                let (word, count) = match outcome {
                    MatchOutcome::Right => ("true positive", Some(&mut counts.true_positives)),
                    MatchOutcome::Wrong => ("false positive", Some(&mut counts.false_positives)),
                    MatchOutcome::Ignored => ("ignored", None),
                };
                one.outcome = word;
                *count.unwrap_or(&mut 0) += usize::from(one.score >= COUNTED);
            }
            counts.false_negatives = counts.objects - counts.true_positives;
            (group, counts)
        };
        let counts = self.groups.names().into_iter().map(count).collect();
        (counts, boxes)
    }
}

impl<'a> BoxLine<'a> {
    /// A box that belongs to no group, or is beyond those that are scored.
    fn of(found: &'a Detection) -> Self {
        let corners = [found.bbox.x1, found.bbox.y1, found.bbox.x2, found.bbox.y2];
        Self { class: &found.class, group: None, score: found.score, corners, outcome: "not scored" }
    }
}
