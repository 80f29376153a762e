//! [`Evaluation::draw`]: images with the labelled and the detected boxes, for the report: figure 2 of the paper.

use std::collections::BTreeMap;
use std::path::Path;

use modulo_ap::difficulty::DONT_CARE;
use modulo_bags::source::GroundTruth;
use modulo_core::{BBox, Detection, Frame};
use modulo_draw::{LabelledBox, Picture, class_colour, distinct, sheet};
use modulo_runtime::{Clock, StreamKind, StreamScale};

use crate::chain::Chain;
use crate::engine::units;
use crate::feeds::Feed;
use crate::frames::{FrameRecord, Walk};
use crate::messages::image;
use crate::plan::Cell;
use crate::results::{self, Point, Results};
use crate::run::Evaluation;
use crate::store::{CellSlice, Folder};
use crate::stored::Stored;
use crate::{GridError, labels, report};

/// Lowest score of a box that is counted as found.
pub(crate) const LEAST_SHOWN: f32 = 0.25;
/// Least IoU of a box and the object that it finds.
const LEAST_IOU: f32 = 0.5;
/// Colour of labelled boxes.
const WHITE: [u8; 3] = [0xff; 3];

impl Evaluation<'_> {
    /// Draws the frame in which the cells differ most in the objects that they find: those of the first model, lens, noise and method, for
    /// each alpha, with the boxes in the folder `out`, where it is saved. Returns the name of the frame, the model, and the sensor but alpha;
    /// `None` without such cells.
    ///
    /// # Errors
    /// [`GridError`] if a step fails, or the image cannot be written.
    pub fn draw(self, out: &Path, timer: &dyn Clock, results: &Results) -> Result<Option<String>, GridError> {
        let of_feeds = || self.feeds.iter().flat_map(|feed| &feed.cells).map(|cell| &cell.key.point);
        // The folder may have cells of other runs.
        let own = results.cells.iter().filter(|cell| of_feeds().any(|point| *point == cell.point));
        let own: Vec<results::Cell> = own.cloned().collect();
        let selected = selected(&own);
        let mut feeds = self.feeds.into_iter().map(|mut feed| {
            feed.cells.retain(|cell| selected.contains(&&cell.key.point));
            feed
        });
        let Some(mut feed) = feeds.find(|feed| !feed.cells.is_empty()) else { return Ok(None) };
        let stored = Stored::read(&[Folder::existing(out)?])?;
        let shown = shown(&stored, &feed)?;
        let Some(frame) = most_differing(&stored, &feed, &shown) else { return Ok(None) };
        let pictures = pictures_of(&mut feed, timer, frame, &shown)?;
        let named = |point: &&Point| {
            let picture = pictures.iter().find(|(of, _)| of == *point).map(|(_, picture)| picture.clone());
            (format!("alpha {}: {}", point.sensor.alpha, labels::stream(point)), picture)
        };
        let named: Vec<_> = selected.iter().map(named).collect();
        let classes = shown.iter().filter_map(|shown| shown.get(&frame.place)).flatten();
        let classes = distinct(classes.map(|found| &*found.class));
        let Some(sheet) = sheet(&named, &classes) else { return Ok(None) };
        report::save_pictures(out, &sheet)?;
        let conditions = labels::conditions(&labels::conditions_of(selected[0]));
        Ok(Some(format!("{}, {}, {conditions}", frame.name, labels::model(selected[0]))))
    }
}

/// The points of one cell for each alpha and each stream, in the order of the paper: those of the first model, lens, noise and method.
fn selected(cells: &[results::Cell]) -> Vec<&Point> {
    let Some(first) = labels::all_conditions(cells).into_iter().next() else { return Vec::new() };
    let own: Vec<&Point> =
        cells.iter().map(|cell| &cell.point).filter(|point| labels::conditions_of(point) == first).collect();
    // All methods, lenses and models would make a table of hundreds of images. The first ones in the order of the grid
    // are those that the user named first.
    let method = own.iter().find_map(|point| point.method.as_ref());
    let is_first = |point: &&&Point| {
        let is_of_method = point.method.is_none() || point.method.as_ref() == method;
        labels::model(point) == labels::model(own[0]) && is_of_method && !point.deblur
    };
    let mut selected: Vec<&Point> = own.iter().filter(is_first).copied().collect();
    // The order of the cells is that of the streams.
    selected.sort_by(|a, b| a.sensor.alpha.total_cmp(&b.sensor.alpha));
    selected
}

/// The boxes that are drawn of a cell, by the places of the frames with an answer.
type Shown = BTreeMap<usize, Vec<Detection>>;

/// The boxes of each cell of `feed`.
fn shown(stored: &Stored, feed: &Feed<'_>) -> Result<Vec<Shown>, GridError> {
    let mut shown = vec![Shown::new(); feed.cells.len()];
    for cell in stored.cells() {
        let CellSlice { key, frames, .. } = cell?;
        let own = feed.cells.iter().position(|cell| cell.key == key);
        let Some(own) = own else { continue };
        let least = feed.cells[own].detecting().score_threshold;
        let drawn = |boxes: Vec<Detection>| {
            boxes.into_iter().filter(|found| f64::from(found.score) >= least).collect()
        };
        shown[own] =
            frames.into_iter().filter_map(|frame| Some((frame.place, drawn(frame.boxes?)))).collect();
    }
    Ok(shown)
}

/// The frame in which the numbers of the objects that the cells find differ most; of those, the one with the most objects. Without labels, the
/// numbers of the boxes count.
fn most_differing<'s>(stored: &'s Stored, feed: &Feed<'_>, shown: &[Shown]) -> Option<&'s FrameRecord> {
    let rank = |frame: &&FrameRecord| {
        let labels: Option<Vec<&GroundTruth>> =
            frame.truth.as_ref().map(|truth| truth.iter().filter(|label| label.class != DONT_CARE).collect());
        let is_found = |label: &&&GroundTruth, boxes: &[Detection]| {
            boxes.iter().any(|found| found.bbox.iou(label.bbox) >= LEAST_IOU)
        };
        let count = |boxes: &Vec<Detection>| match &labels {
            Some(labels) => labels.iter().filter(|label| is_found(label, boxes)).count(),
            None => boxes.len(),
        };
        let counts = || shown.iter().filter_map(|shown| shown.get(&frame.place).map(count));
        let spread = counts().max().unwrap_or(0) - counts().min().unwrap_or(0);
        (spread, labels.as_ref().map_or(0, Vec::len))
    };
    // Of equal ones, the first.
    stored.scenes.get(&feed.name)?.frames.values().rev().max_by_key(rank)
}

/// Makes the images of one frame of the cells again, with the boxes that are stored.
fn pictures_of(
    feed: &mut Feed<'_>,
    timer: &dyn Clock,
    record: &FrameRecord,
    shown: &[Shown],
) -> Result<Vec<(Point, Picture)>, GridError> {
    let Feed { frames, cells, .. } = feed;
    let (place, is_still) = (record.place, frames.is_still);
    let slice = frames.inspect(place..place + 1);
    let is_ordered = units(cells, is_still).iter().any(|unit| unit.is_ordered);
    let alone: Vec<[&Cell<'_>; 1]> = cells.iter().map(|cell| [cell]).collect();
    let chains = alone.iter().map(|cell| Chain::new(cell, timer, false));
    let mut chains = chains.collect::<Result<Vec<_>, _>>()?;
    let (truth, mut pictures) = (record.truth.clone().unwrap_or_default(), Vec::new());
    for frame in Walk::new(frames, &slice, is_ordered) {
        let (index, frame) = frame?;
        for (chain, (cell, boxes)) in chains.iter_mut().zip(cells.iter().zip(shown)) {
            if index.is_some() || chain.needs_all() {
                chain.complete(None, 0)?;
            }
            let out = chain.tick(&frame, is_still)?;
            let boxes: Vec<&Detection> = boxes.get(&place).into_iter().flatten().collect();
            let picture = image(&out, &cell.stream.images).filter(|_| index.is_some());
            let picture = picture.and_then(|shown| picture_of(&shown.frame, &cell.key.point, &truth, &boxes));
            pictures.extend(picture.map(|picture| (cell.key.point.clone(), picture)));
        }
    }
    Ok(pictures)
}

/// The image as a screen needs it, which is brighter than what the detector reads.
fn picture_of(frame: &Frame, point: &Point, truth: &[GroundTruth], found: &[&Detection]) -> Option<Picture> {
    let pixels = frame.as_u8()?;
    let (height, width, channels) = pixels.dim();
    let kind = match point.stream.rsplit('.').next().unwrap_or_default() {
        "modulo" => StreamKind::Modulo,
        "saturated" | "auto_exposed" => StreamKind::Saturated,
        // All others have the full range.
        _ => StreamKind::Ideal,
    };
    let shown = StreamScale::of(Some(kind), frame.depth(), Some(&point.sensor), 0)?.light?.shown();
    let repeated = if channels == 1 { 3 } else { 1 };
    let rgb = pixels.iter().flat_map(|&code| std::iter::repeat_n(shown[usize::from(code)], repeated));
    let boxed = |b: BBox, colour, label| LabelledBox { corners: [b.x1, b.y1, b.x2, b.y2], colour, label };
    let found = found.iter().map(|d| boxed(d.bbox, class_colour(&d.class), format!("{:.2}", d.score)));
    let labelled = truth.iter().filter(|label| label.class != DONT_CARE);
    let boxes = found.chain(labelled.map(|label| boxed(label.bbox, WHITE, String::new()))).collect();
    Picture::new(u32::try_from(width).ok()?, u32::try_from(height).ok()?, rgb.collect(), boxes).ok()
}
