//! Pictures of a grid: what the detectors saw, and where they were worst.

use std::collections::BTreeMap;

use modulo_bags::source::GroundTruth;
use modulo_charts::Picture;
use modulo_core::{Detection, Frame};
use modulo_runtime::Clock;

use super::eye::Memory;
use super::frames::Frames;
use super::moment::{Moments, Neighbours};
use super::nodes::Nodes;
use super::run::Workshop;
use super::{GridError, Request};
use crate::chart::{Named, Shot, pictures};
use crate::classes::DONT_CARE;
use crate::results::{Point, Results};

/// Least score of a box that is drawn.
const LEAST_SHOWN: f32 = 0.25;
/// Which of a chart's colours a box has: labelled, found.
const COLOURS: [usize; 2] = [0, 1];

/// The paper's figure 2 over the alphas of `results`, and the worst frame of each stream, for the first model, lens and
/// method. Nothing where there is no cell.
///
/// # Errors
/// [`GridError`] when a step cannot go on.
pub fn show(
    request: &Request,
    nodes: &dyn Nodes,
    timer: &dyn Clock,
    results: &Results,
) -> Result<Vec<Named>, GridError> {
    let mut frames = Frames::inspect(&request.data)?;
    let busy = |truth: &Vec<GroundTruth>| truth.iter().filter(|label| label.class != DONT_CARE).count();
    let busiest = (0..frames.len()).rev().max_by_key(|&number| busy(&frames.truths[number])).unwrap_or(0);
    let wanted = pictures::wanted(results, busiest);
    let shots = shots(request, nodes, timer, &mut frames, &wanted)?;
    Ok(pictures::charts(results, &shots))
}

/// Runs the wanted frames again, cell by cell.
fn shots(
    request: &Request,
    nodes: &dyn Nodes,
    timer: &dyn Clock,
    frames: &mut Frames,
    wanted: &[(Point, usize)],
) -> Result<Vec<Shot>, GridError> {
    let mut workshop = Workshop::new(request, nodes, timer);
    let mut by_frame: BTreeMap<usize, Vec<&Point>> = BTreeMap::new();
    wanted.iter().for_each(|(point, number)| by_frame.entry(*number).or_default().push(point));
    let truths = frames.truths.clone();
    let mut shots = Vec::new();
    for moment in Moments::new(frames, Neighbours::Dropped)? {
        let moment = moment?;
        for point in by_frame.remove(&moment.number).unwrap_or_default() {
            workshop.open_eyes(point)?;
            let passed = workshop.way(point)?(moment.again())?;
            let (Some(image), Some(eye)) = (passed.image, workshop.eyes.first_mut()) else { continue };
            let answer = eye.look(moment.number, image.clone(), &Memory::default())?;
            let found = answer.found.as_deref().map_or(&[][..], Vec::as_slice);
            let Some(picture) = picture(&image.frame, &truths[moment.number], found) else { continue };
            let (point, frame) = (point.clone(), moment.frame.name.clone());
            shots.push(Shot { point, number: moment.number, frame, picture });
        }
    }
    Ok(shots)
}

fn picture(frame: &Frame, truth: &[GroundTruth], found: &[Detection]) -> Option<Picture> {
    let pixels = frame.as_u8()?;
    let (height, width, channels) = pixels.dim();
    let rgb =
        pixels.iter().flat_map(|&sample| std::iter::repeat_n(sample, if channels == 1 { 3 } else { 1 }));
    let labelled =
        truth.iter().filter(|label| label.class != DONT_CARE).map(|label| (label.bbox, COLOURS[0]));
    let found = found.iter().filter(|d| d.score >= LEAST_SHOWN).map(|d| (d.bbox, COLOURS[1]));
    let boxes = labelled.chain(found).map(|(b, colour)| ([b.x1, b.y1, b.x2, b.y2], colour)).collect();
    Picture::new(u32::try_from(width).ok()?, u32::try_from(height).ok()?, rgb.collect(), boxes).ok()
}
