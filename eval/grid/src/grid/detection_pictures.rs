//! [`draw_pictures`]: images with the labelled and the detected boxes, for the report.

use modulo_ap::difficulty::DONT_CARE;
use modulo_bags::source::GroundTruth;
use modulo_core::{BBox, Detection, Frame};
use modulo_draw::{LabelledBox, Picture, class_colour, distinct};
use modulo_runtime::{Clock, StreamKind, StreamScale};

use super::frames::{Frames, FramesWithNeighbours};
use super::pipeline::{self, MakeDetector};
use super::runner::CellRunner;
use super::{GridError, Request};
use crate::chart::NamedChart;
use crate::chart::pictures::{self, DetectionPicture};
use crate::results::{Cell, Point, Results, Stream};

/// Lowest score of a box that is drawn.
const LEAST_SHOWN: f32 = 0.25;
/// Colour of labelled boxes.
const WHITE: [u8; 3] = [0xff; 3];

/// Draws figure 2 of the paper over the alphas of `results`, for the first model, lens and method of the request. Without cells
/// there is no chart.
///
/// # Errors
/// [`GridError`] if a step fails.
pub fn draw_pictures(
    request: &Request,
    make: &MakeDetector,
    timer: &dyn Clock,
    results: &Results,
) -> Result<Option<NamedChart>, GridError> {
    let mut frames = Frames::inspect(&request.data, &request.source())?;
    let busy = |truth: &Vec<GroundTruth>| truth.iter().filter(|label| label.class != DONT_CARE).count();
    let busiest = (0..frames.len()).rev().max_by_key(|&number| busy(&frames.scored[number].truth));
    let busiest = busiest.expect("data without a scored frame is refused");
    // The folder may have cells of models that are not at hand.
    let mut results = results.clone();
    results.cells.retain(|cell| request.model(&cell.point.model).is_ok());
    let cells = pictures::selected(&results);
    let pictures = detect(request, make, timer, (&mut frames, busiest), &cells)?;
    let name = &frames.scored[busiest].name;
    Ok((!pictures.is_empty()).then(|| pictures::chart(&results, name, &cells, &pictures)))
}

/// Runs frame `number` of the wanted cells again.
fn detect(
    request: &Request,
    make: &MakeDetector,
    timer: &dyn Clock,
    (frames, number): (&mut Frames, usize),
    wanted: &[&Cell],
) -> Result<Vec<DetectionPicture>, GridError> {
    let truth = frames.scored[number].truth.clone();
    let frame = FramesWithNeighbours::new(frames, false)?.nth(number).transpose()?;
    let Some(frame) = frame else { return Ok(Vec::new()) };
    let (mut runner, mut pictures) = (CellRunner::new(request, make, timer), Vec::new());
    for Cell { point: of, .. } in wanted {
        runner.load_detector(of)?;
        let input = pipeline::open(request, timer, of, false)?(frame.clone())?;
        let (Some(image), Some(worker)) = (input.image, runner.workers.first_mut()) else { continue };
        let found = worker.infer(number, image.clone())?.0.unwrap_or_default();
        let shown: Vec<&Detection> = found.iter().filter(|d| d.score >= LEAST_SHOWN).collect();
        let Some(picture) = picture(&image.frame, of, &truth, &shown) else { continue };
        let classes = distinct(shown.into_iter().map(|d| d.class.clone()));
        pictures.push(DetectionPicture { of: of.clone(), classes, picture });
    }
    Ok(pictures)
}

/// The image as a screen needs it, which is brighter than what the detector reads.
fn picture(frame: &Frame, point: &Point, truth: &[GroundTruth], found: &[&Detection]) -> Option<Picture> {
    let pixels = frame.as_u8()?;
    let (height, width, channels) = pixels.dim();
    let kind = match point.stream {
        Stream::Modulo => StreamKind::Modulo,
        Stream::Saturated | Stream::AutoExposed => StreamKind::Saturated,
        // All of these have the full range.
        Stream::Ideal
        | Stream::Recovered
        | Stream::Metered
        | Stream::MultiExposure
        | Stream::MultiExposureStill => StreamKind::Ideal,
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
