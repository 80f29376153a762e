//! `bench detector`: the inference engines of this machine, with the time of each and the agreement of its boxes.
//!
//! Each engine is a run of this program of its own, in lockstep on the same frames. The boxes are compared with those of an
//! engine that computes with 32 bits on the processor: ONNX Runtime where it is, else rten.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use modulo_core::BBox;
use modulo_draw::{Axis, Chart, ChartBody, ChartPanel, DataPoint, PageWidth, Series, SeriesStyle};
use serde::Serialize;

use crate::pipeline::{Mode, Program, RESULTS, RunSettings, SuiteRequest, at, run, sorted, temporary_folder};
use crate::{BenchError, BenchEvent, make_folder, read_json, write, write_json};

/// Engines and devices in the order in which they are measured; the first one that is there is the reference.
const ENGINES: [(&str, &str); 5] =
    [("ort", "cpu"), ("rten", "cpu"), ("openvino", "cpu"), ("ort", "cuda"), ("ort", "tensorrt")];
/// The boxes with at least this score are compared.
const SCORE: f64 = 0.25;
/// Boxes of two engines that agree have scores that are at most so far apart.
const SCORE_TOLERANCE: f64 = 0.03;
/// Boxes of two engines that agree have at least this intersection over union.
const LEAST_IOU: f32 = 0.9;
/// The smallest share of agreeing boxes of an engine that may stand for the reference.
const LEAST_AGREEMENT: f64 = 0.99;

/// An engine on this machine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EngineRow {
    /// The engine, as the parameter `engine` has it.
    pub engine: &'static str,
    /// The device, as the parameter `device` has it.
    pub device: &'static str,
    /// The figures, or the reason why it does not run here.
    #[serde(flatten)]
    pub outcome: EngineOutcome,
}

/// The result of the run of an engine.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum EngineOutcome {
    /// It ran.
    Measured(EngineFigures),
    /// It did not run, for this reason.
    Missing(String),
}

/// The figures of an engine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EngineFigures {
    /// Number of frames that were timed.
    pub frames: usize,
    /// Median time of an inference, ms.
    pub p50_ms: f64,
    /// The 99th percentile of this time, ms.
    pub p99_ms: f64,
    /// Number of boxes with a score of at least 0.25.
    pub boxes: usize,
    /// Share of the boxes of this engine and of the reference that have a twin of the same class on the other side: intersection
    /// over union of at least 0.9, scores at most 0.03 apart.
    pub agreement: f64,
}

impl EngineRow {
    /// Returns the figures of an engine that runs here.
    pub fn figures(&self) -> Option<&EngineFigures> {
        match &self.outcome {
            EngineOutcome::Measured(figures) => Some(figures),
            EngineOutcome::Missing(_) => None,
        }
    }
}

/// Measures all engines on this `processor` and writes the results. Returns the rows and the files of the chart.
///
/// # Errors
/// [`BenchError`] when no engine runs, or a file cannot be read or written.
pub fn engines(
    request: &SuiteRequest,
    program: &Program<'_>,
    processor: &str,
    tell: &mut dyn FnMut(BenchEvent<'_>),
) -> Result<(Vec<EngineRow>, [PathBuf; 2]), BenchError> {
    make_folder(&request.out)?;
    let mut rows = Vec::new();
    let mut reference: Option<Boxes> = None;
    for (done, (engine, device)) in ENGINES.into_iter().enumerate() {
        tell(BenchEvent::Step { done, total: ENGINES.len(), next: engine });
        let outcome = match measure(request, program, (engine, device)) {
            Ok((times, boxes)) => {
                let reference = reference.get_or_insert_with(|| boxes.clone());
                EngineOutcome::Measured(EngineFigures {
                    frames: times.len(),
                    p50_ms: at(&times, 0.5),
                    p99_ms: at(&times, 0.99),
                    boxes: counted(&boxes).count(),
                    agreement: agreement(&boxes, reference),
                })
            }
            Err(BenchError::Run(why)) => EngineOutcome::Missing(why),
            Err(why) => return Err(why),
        };
        rows.push(EngineRow { engine, device, outcome });
    }
    if reference.is_none() {
        let why = |row: &EngineRow| match &row.outcome {
            EngineOutcome::Missing(why) => why.clone(),
            EngineOutcome::Measured(_) => String::new(),
        };
        return Err(BenchError::Run(rows.iter().map(why).collect::<Vec<_>>().join("; ")));
    }
    write_json(&request.out.join(RESULTS), &rows)?;
    let chart = chart(&rows, request, processor);
    let files = ["engines.svg", "engines.png"].map(|name| request.out.join(name));
    write(&files[0], chart.svg(PageWidth::Wide)?.as_bytes())?;
    write(&files[1], &chart.png()?)?;
    Ok((rows, files))
}

/// Returns the fastest engine on the processor whose boxes agree with the reference.
pub fn fastest(rows: &[EngineRow]) -> Option<&EngineRow> {
    let candidates = rows.iter().filter(|row| row.device == "cpu");
    let agreeing =
        candidates.filter_map(|row| Some((row, row.figures().filter(|f| f.agreement >= LEAST_AGREEMENT)?)));
    agreeing.min_by(|(_, a), (_, b)| a.p50_ms.total_cmp(&b.p50_ms)).map(|(row, _)| row)
}

/// A box as `modulo eval` writes it: x1, y1, x2, y2 in px, score, class.
type ScoredBox = (f32, f32, f32, f32, f64, String);
/// The boxes of each frame.
type Boxes = BTreeMap<String, Vec<ScoredBox>>;

/// Returns the times of the inferences of an engine in ascending order, ms, and its boxes.
fn measure(
    request: &SuiteRequest,
    program: &Program<'_>,
    (engine, device): (&str, &str),
) -> Result<(Vec<f64>, Boxes), BenchError> {
    let folder = temporary_folder()?;
    // Boxes at the limit of the score must find their twins below it.
    let more = [format!("score_threshold:={}", SCORE - SCORE_TOLERANCE)];
    let settings =
        RunSettings { mode: Mode::Lockstep, suite: request, engine, device, rate: 0.0, more: &more };
    let mut run = run(&settings, request.count, program, folder.path())?;
    let times = sorted(run.times.stages.remove("detector infer").unwrap_or_default());
    if times.is_empty() {
        return Err(BenchError::Run("no frame was timed; choose a larger --count".to_owned()));
    }
    Ok((times, read_json(&folder.path().join("recovered.json"))?))
}

/// Returns the boxes that are compared, each with the name of its frame.
fn counted(boxes: &Boxes) -> impl Iterator<Item = (&String, &ScoredBox)> {
    boxes
        .iter()
        .flat_map(|(frame, boxes)| boxes.iter().map(move |one| (frame, one)))
        .filter(|(_, one)| one.4 >= SCORE)
}

/// Returns the share of the boxes of both sides that have a twin on the other side; 1 where there are no boxes.
fn agreement(left: &Boxes, right: &Boxes) -> f64 {
    let with_twin = |own: &Boxes, other: &Boxes| {
        counted(own)
            .filter(|(frame, one)| {
                other.get(*frame).is_some_and(|boxes| boxes.iter().any(|twin| are_twins(one, twin)))
            })
            .count()
    };
    let all = counted(left).count() + counted(right).count();
    if all == 0 { 1.0 } else { (with_twin(left, right) + with_twin(right, left)) as f64 / all as f64 }
}

fn are_twins(one: &ScoredBox, other: &ScoredBox) -> bool {
    let place = |&(x1, y1, x2, y2, ..): &ScoredBox| BBox { x1, y1, x2, y2 };
    one.5 == other.5
        && (one.4 - other.4).abs() <= SCORE_TOLERANCE
        && place(one).iou(place(other)) >= LEAST_IOU
}

/// Returns the name of the file of a model.
fn name_of(model: &str) -> Cow<'_, str> {
    Path::new(model).file_name().map_or(model.into(), |name| name.to_string_lossy())
}

fn chart(rows: &[EngineRow], request: &SuiteRequest, processor: &str) -> Chart {
    let frames = rows.iter().find_map(EngineRow::figures).map_or(0, |figures| figures.frames);
    let series = rows.iter().filter_map(|row| {
        let EngineFigures { p50_ms, agreement, .. } = *row.figures()?;
        let name = format!("{} on {}", row.engine, row.device);
        let hover = format!("{name}: {p50_ms:.1} ms, {:.2} % of the boxes agree", 100.0 * agreement);
        let point = DataPoint { x: p50_ms, y: agreement, hover, ..DataPoint::default() };
        Some(Series { points: vec![point], style: SeriesStyle::LineAndMarkers, name })
    });
    Chart {
        title: "Inference engines: the time of each, and the agreement of its boxes".to_owned(),
        subtitle: format!("{} on {frames} frames, alpha {}; {processor}", name_of(&request.model), request.alpha),
        footer: "Agreement: a twin of the same class with the reference, IoU of at least 0.9 and scores at most 0.03 apart.".to_owned(),
        body: ChartBody::Panels(vec![ChartPanel {
            x: Axis::log(format!("median time of an inference, ms, {frames} frames")),
            y: Axis::percent(format!("boxes that agree, %, {frames} frames"), 1.0),
            series: series.collect(),
        }]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boxes(list: &[(f32, f64, &str)]) -> Boxes {
        let boxes =
            list.iter().map(|&(x1, score, class)| (x1, 0.0, x1 + 100.0, 50.0, score, class.to_owned()));
        BTreeMap::from([("a".to_owned(), boxes.collect())])
    }

    #[test]
    fn boxes_agree_in_class_place_and_score() {
        let reference = boxes(&[(0.0, 0.9, "car"), (300.0, 0.26, "van")]);
        let share = |list: &[(f32, f64, &str)]| agreement(&boxes(list), &reference);
        assert_eq!(share(&[(0.0, 0.9, "car"), (300.0, 0.26, "van")]), 1.0);
        // 96 px of 104 px in common: 0.92. A box below the limit of the score is a twin, but is not counted itself.
        assert_eq!(share(&[(4.0, 0.88, "car"), (300.0, 0.24, "van")]), 1.0);
        assert_eq!(share(&[(6.0, 0.9, "car"), (300.0, 0.26, "van")]), 0.5);
        assert_eq!(share(&[(0.0, 0.86, "car"), (300.0, 0.26, "van")]), 0.5);
        assert_eq!(share(&[(0.0, 0.9, "van"), (300.0, 0.26, "van")]), 0.5);
        assert_eq!(share(&[]), 0.0);
        assert_eq!(agreement(&boxes(&[]), &boxes(&[])), 1.0);
    }

    #[test]
    fn the_fastest_engine_is_one_that_agrees() {
        let row = |engine, device, p50_ms, agreement| {
            let figures = EngineFigures { frames: 1, p50_ms, p99_ms: p50_ms, boxes: 1, agreement };
            EngineRow { engine, device, outcome: EngineOutcome::Measured(figures) }
        };
        let missing =
            EngineRow { engine: "ort", device: "tensorrt", outcome: EngineOutcome::Missing("no GPU".into()) };
        let rows = [
            row("ort", "cpu", 50.0, 1.0),
            row("rten", "cpu", 100.0, 1.0),
            row("openvino", "cpu", 20.0, 0.98),
            row("ort", "cuda", 5.0, 1.0),
            missing,
        ];
        assert_eq!(fastest(&rows).map(|row| row.engine), Some("ort"));
        assert_eq!(fastest(&rows[2..]), None);
    }
}
