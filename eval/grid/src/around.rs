//! The accuracy around a change of the light: which frames lie how long before and after it, and whether the nearest object was found.

use modulo_ap::average::{self, Membership};
use modulo_ap::matching::{ImageBoxes, ObjectRole};
use modulo_bags::source::{GroundTruth, LightChange};
use modulo_core::Detection;

use crate::results::Moment;
use crate::score::{Found, Scorer, share};

/// The frames before a change, and those after it, that are looked at.
const BEFORE: i64 = 6;
const AFTER: i64 = 24;

/// Least score of the boxes that are counted, which is that of the boxes on the images of the report.
const COUNTED: f32 = 0.25;
/// Least IoU of a box and the object that it finds.
const LEAST_IOU: f64 = 0.5;

/// The number of frames of a moment: one alone has too few objects.
const LENGTH: i64 = 2;

impl Scorer<'_> {
    /// Returns whether each frame has the nearest of its scored objects among its boxes of a score of at least [`COUNTED`]; `None` without a scored
    /// object. The nearest object has the highest box.
    pub(crate) fn nearest_found(&self, found: &Found) -> Vec<Option<bool>> {
        found
            .iter()
            .zip(&self.frames)
            .map(|(found, frame)| self.is_nearest_found(found, frame.truth))
            .collect()
    }

    fn is_nearest_found(&self, found: &[Detection], truth: &[GroundTruth]) -> Option<bool> {
        let names = self.groups.names();
        let group = |class: &str| {
            names.iter().find(|group| self.groups.membership(class, group) == Membership::Member)
        };
        let height = |label: &&GroundTruth| label.bbox.y2 - label.bbox.y1;
        let scored = truth.iter().filter(|label| {
            self.difficulty.role(label) == ObjectRole::Counts && group(&label.class).is_some()
        });
        let nearest = scored.max_by(|a, b| height(a).total_cmp(&height(b)))?;
        let is_hit = |one: &Detection| {
            one.score >= COUNTED
                && group(&one.class) == group(&nearest.class)
                && f64::from(one.bbox.iou(nearest.bbox)) >= LEAST_IOU
        };
        Some(found.iter().any(is_hit))
    }

    /// Returns the accuracy at each moment before and after the changes to darker and to brighter light; empty where the light does not change.
    pub(crate) fn moments(&self, groups: &[Vec<ImageBoxes>], nearest: &[Option<bool>]) -> Vec<Moment> {
        let mut moments = Vec::new();
        for is_darker in [true, false] {
            for frame in (-BEFORE..AFTER).step_by(LENGTH as usize) {
                let is_here = |change: &Option<LightChange>| {
                    change.is_some_and(|change| {
                        change.is_darker == is_darker && (frame..frame + LENGTH).contains(&change.frames)
                    })
                };
                let here: Vec<usize> =
                    (0..nearest.len()).filter(|&at| is_here(&self.frames[at].record.change)).collect();
                let ap50 = groups.iter().filter_map(|images| {
                    let images: Vec<ImageBoxes> = here.iter().map(|&at| images[at].clone()).collect();
                    average::ap(&images, 0.5)
                });
                let (ap50, frames) = (average::mean(ap50), here.len());
                let nearest = share(here.iter().filter_map(|&at| nearest[at]));
                if frames > 0 {
                    moments.push(Moment { is_darker, frame, frames, ap50, nearest });
                }
            }
        }
        moments
    }
}
