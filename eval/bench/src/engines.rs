//! `bench detector`: the inference engines of this machine, with the accuracy, the time and the memory of each.
//!
//! Each engine with each model is a run of `modulo eval` of its own on the same labelled frames, twice: the second time in the opposite order,
//! so that a machine that becomes slower prefers none of them. The loss of accuracy counts
//! from the first model on an engine that computes with 32 bits on the processor: ONNX Runtime where it is, else rten.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use clap::Args;
use modulo_runtime::output::ResultFolder;
use modulo_runtime::report::Percentiles;
use serde::{Deserialize, Serialize};

use crate::pipeline::{Mode, temporary_folder, watch};
use crate::{BenchError, BenchEvent, RESULTS, read_json, write_json};

/// Engines and devices in the order in which they are measured; the first one that is there is the reference.
const ENGINES: [(&str, &str); 6] = [
    ("ort", "cpu"),
    ("rten", "cpu"),
    ("openvino_f32", "cpu"),
    ("openvino", "cpu"),
    ("ort", "cuda"),
    ("ort", "tensorrt"),
];
/// An engine may stand for the reference if it loses less AP50 than this in each group.
pub const MOST_LOSS: f64 = 0.005;
/// Fewer labelled frames do not tell the accuracy of an engine.
const LEAST_FRAMES: usize = 20;

/// The settings of a benchmark of the engines, as options of a command line.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct EnginesRequest {
    /// Detection models, such as an ONNX file and its copy with 8 bits (tools/quantise.py), or demo: the embedded demonstration.
    /// The first one is the reference
    #[arg(long, value_delimiter = ',', default_value = "demo")]
    pub model: Vec<String>,
    /// Saturation factor: brightest radiance divided by the peak of the sensor
    #[arg(long, default_value_t = 4.0)]
    pub alpha: f64,
    /// Standard deviation of the lens blur in px. 0: a perfect lens
    #[arg(long, default_value_t = 1.4)]
    pub psf_sigma: f64,
    /// Number of inferences of each engine whose times are measured
    #[arg(long, default_value_t = 100)]
    pub count: usize,
    /// Folder for results.json; without it a new one in runs
    #[arg(short, long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    /// Further options of modulo eval, such as -- --groups FILE
    #[arg(last = true)]
    pub more: Vec<OsString>,
}

/// An engine with a model on this machine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EngineRow {
    /// The engine, as the parameter `engine` has it.
    pub engine: &'static str,
    /// The device, as the parameter `device` has it.
    pub device: &'static str,
    /// The model, as the parameter `model` has it.
    pub model: String,
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
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct EngineFigures {
    /// Number of labelled frames.
    pub frames: usize,
    /// AP50 of each group of classes that has an object in the labels.
    pub ap50: BTreeMap<String, f64>,
    /// Bounds of the 95 % bootstrap interval of each AP50.
    pub interval95: BTreeMap<String, [f64; 2]>,
    /// The largest loss of AP50 of a group against the reference; negative where each group gains.
    pub loss: f64,
    /// Number of inferences whose times were measured.
    pub inferences: usize,
    /// Median time of an inference, ms: the mean of both turns.
    pub p50_ms: f64,
    /// Median time of an inference in each turn, ms.
    pub turns_ms: [f64; 2],
    /// The 99th percentile of this time, ms.
    pub p99_ms: f64,
    /// Largest resident memory of the process, sensor and unwrapping included, MB.
    pub rss_mb: f64,
}

impl EngineRow {
    /// Returns the figures of an engine that runs here.
    pub fn figures(&self) -> Option<&EngineFigures> {
        match &self.outcome {
            EngineOutcome::Measured(figures) => Some(figures),
            EngineOutcome::Missing(_) => None,
        }
    }

    /// Returns the arguments of the launch files that take this engine and model.
    pub fn arguments(&self) -> String {
        let Self { engine, device, model, .. } = self;
        format!("engine:={engine} device:={device} model:={model}")
    }
}

/// Measures all engines on the frames that the options `source` of `modulo eval` name, and writes the results. `program` is the
/// path of this program.
///
/// # Errors
/// [`BenchError`] when no engine runs, there are too few frames, or a file cannot be read or written.
pub fn engines(
    request: &EnginesRequest,
    source: &[OsString],
    program: &Path,
    tell: &mut dyn FnMut(BenchEvent<'_>),
) -> Result<Vec<EngineRow>, BenchError> {
    if request.count == 0 {
        return Err(BenchError::number("count", 0, "at least 1"));
    }
    let out = ResultFolder::take(request.out.as_deref(), "detector", None)?;
    let rows = rows(request, source, program, tell)?;
    write_json(&out.path().join(RESULTS), &rows)?;
    Ok(rows)
}

/// Measures each engine with each model; at least one of them runs.
fn rows(
    request: &EnginesRequest,
    source: &[OsString],
    program: &Path,
    tell: &mut dyn FnMut(BenchEvent<'_>),
) -> Result<Vec<EngineRow>, BenchError> {
    let mut rows: Vec<EngineRow> = Vec::new();
    for model in &request.model {
        for (engine, device) in ENGINES {
            let total = 2 * request.model.len() * ENGINES.len();
            tell(BenchEvent::Step { done: rows.len(), total, next: engine });
            let mut row = EngineRow {
                engine,
                device,
                model: model.clone(),
                outcome: EngineOutcome::Missing(String::new()),
            };
            row.outcome = match measure(request, &row, source, program) {
                Ok(mut figures) => {
                    let reference = rows.iter().find_map(EngineRow::figures);
                    figures.loss = reference.map_or(0.0, |reference| loss(&reference.ap50, &figures.ap50));
                    EngineOutcome::Measured(figures)
                }
                Err(BenchError::Run(why)) => EngineOutcome::Missing(why),
                Err(why) => return Err(why),
            };
            rows.push(row);
        }
    }
    take_second_turn(request, source, program, &mut rows, tell)?;
    if rows.iter().all(|row| row.figures().is_none()) {
        // rten is built in: its reason is that of the data or the model.
        let why = rows.iter().find(|row| row.engine == "rten").map(|row| row.outcome.clone());
        let Some(EngineOutcome::Missing(why)) = why else {
            unreachable!("each engine has a row, and none has figures")
        };
        return Err(BenchError::Run(why));
    }
    Ok(rows)
}

/// Measures the times of the engines that run here once more, from the last one to the first one.
fn take_second_turn(
    request: &EnginesRequest,
    source: &[OsString],
    program: &Path,
    rows: &mut [EngineRow],
    tell: &mut dyn FnMut(BenchEvent<'_>),
) -> Result<(), BenchError> {
    let total = 2 * rows.len();
    for (done, row) in (rows.len()..).zip(rows.iter_mut().rev()) {
        tell(BenchEvent::Step { done, total, next: row.engine });
        if row.figures().is_none() {
            continue;
        }
        let again = measure(request, row, source, program)?;
        if let EngineOutcome::Measured(figures) = &mut row.outcome {
            figures.turns_ms[1] = again.p50_ms;
            figures.p50_ms = f64::midpoint(figures.p50_ms, again.p50_ms);
            figures.p99_ms = figures.p99_ms.max(again.p99_ms);
        }
    }
    Ok(())
}

/// Returns the engines that lose less than [`MOST_LOSS`] of AP50 in each group and of which none is known to be faster: first the one with
/// the least median, then those that were faster in a turn than it was in its slower one.
pub fn choice(rows: &[EngineRow]) -> Vec<&EngineRow> {
    let accurate = rows.iter().filter_map(|row| Some((row, row.figures().filter(|f| f.loss < MOST_LOSS)?)));
    let mut accurate: Vec<_> = accurate.collect();
    accurate.sort_by(|(_, a), (_, b)| a.p50_ms.total_cmp(&b.p50_ms));
    let slower_turn = accurate.first().map_or(0.0, |(_, first)| first.turns_ms[0].max(first.turns_ms[1]));
    let overlaps = |figures: &EngineFigures| figures.turns_ms.iter().any(|&ms| ms <= slower_turn);
    accurate.into_iter().filter(|(_, figures)| overlaps(figures)).map(|(row, _)| row).collect()
}

fn loss(reference: &BTreeMap<String, f64>, ap50: &BTreeMap<String, f64>) -> f64 {
    let losses = reference.iter().map(|(group, ap)| ap - ap50.get(group).copied().unwrap_or_default());
    losses.reduce(f64::max).unwrap_or_default()
}

/// The part of the results of `modulo eval` that is used here.
#[derive(Deserialize)]
struct Evaluation {
    cells: Vec<EvaluatedCell>,
}

#[derive(Deserialize)]
struct EvaluatedCell {
    frames: usize,
    ap50: BTreeMap<String, Option<f64>>,
    interval95: BTreeMap<String, [f64; 2]>,
    latency_ms: BTreeMap<String, Percentiles>,
    frame_ms: Option<FrameTime>,
}

#[derive(Deserialize)]
struct FrameTime {
    frames: usize,
}

fn measure(
    request: &EnginesRequest,
    row: &EngineRow,
    source: &[OsString],
    program: &Path,
) -> Result<EngineFigures, BenchError> {
    let folder = temporary_folder()?;
    let failed = |why| BenchError::Io(folder.path().to_owned(), why);
    let errors = folder.path().join("errors.txt");
    let mut command = Command::new(program);
    // One job, so that the memory is that of one detector.
    command.arg("eval").args(source).args(["--stream", "recovered", "--method", "auto", "--deblur", "off"]);
    command.args(["--engine", row.engine, "--device", row.device, "--model", &row.model, "--jobs", "1"]);
    command.arg(format!("--alpha={}", request.alpha)).arg(format!("--psf-sigma={}", request.psf_sigma));
    command.arg(format!("--time-frames={}", request.count)).args(&request.more);
    let out = folder.path().join("out");
    command.arg("--out").arg(&out).stdin(Stdio::null()).stdout(Stdio::null());
    command.stderr(fs::File::create(&errors).map_err(failed)?);
    let mut child = command.spawn().map_err(|why| BenchError::Io(program.to_owned(), why))?;
    let (_, rss_mb) = watch(&mut child, Mode::Composed).map_err(failed)?;
    // What was left out of the data or could not be scored ends with exit code 3; the figures are there.
    let results = out.join(RESULTS);
    if !results.exists() {
        let errors = fs::read_to_string(&errors).map_err(failed)?;
        let last = errors.lines().last().unwrap_or("it ended without a word");
        return Err(BenchError::Run(last.trim_start_matches("modulo: ").to_owned()));
    }
    let mut cells = read_json::<Evaluation>(&results)?.cells;
    match (cells.pop(), cells.is_empty()) {
        (Some(cell), true) => figures(cell, rss_mb),
        _ => Err(BenchError::Request(
            "each engine is measured with one setting of modulo eval only".to_owned(),
        )),
    }
}

fn figures(cell: EvaluatedCell, rss_mb: f64) -> Result<EngineFigures, BenchError> {
    let EvaluatedCell { frames, ap50, mut interval95, latency_ms, frame_ms } = cell;
    if frames < LEAST_FRAMES {
        return Err(BenchError::number("the number of labelled frames", frames, "at least 20"));
    }
    let ap50: BTreeMap<String, f64> = ap50.into_iter().filter_map(|(group, ap)| Some((group, ap?))).collect();
    if ap50.is_empty() {
        return Err(BenchError::Request(
            "no labelled object is scored; -- --groups FILE names the classes".to_owned(),
        ));
    }
    let (Some(infer), Some(frame_ms)) = (latency_ms.get("infer"), frame_ms) else {
        return Err(BenchError::Run("no frame was answered".to_owned()));
    };
    let interval95 = ap50.keys().filter_map(|group| interval95.remove_entry(&format!("ap50.{group}")));
    let bare = |key: String| key.trim_start_matches("ap50.").to_owned();
    Ok(EngineFigures {
        frames,
        interval95: interval95.map(|(key, bounds)| (bare(key), bounds)).collect(),
        ap50,
        loss: 0.0,
        inferences: frame_ms.frames,
        p50_ms: infer.p50,
        turns_ms: [infer.p50; 2],
        p99_ms: infer.p99,
        rss_mb,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(engine: &'static str, p50_ms: f64, loss: f64) -> EngineRow {
        let turns_ms = [p50_ms - 1.0, p50_ms + 1.0];
        let figures = EngineFigures { p50_ms, turns_ms, loss, ..EngineFigures::default() };
        EngineRow { engine, device: "cpu", model: "demo".into(), outcome: EngineOutcome::Measured(figures) }
    }

    #[test]
    fn the_choice_is_the_fastest_engine_that_loses_less_than_half_a_point() {
        let missing =
            EngineRow { outcome: EngineOutcome::Missing("no GPU".into()), ..row("tensorrt", 1.0, 0.0) };
        let rows = [
            row("ort", 50.0, 0.0),
            row("rten", 100.0, -0.02),
            row("openvino_f32", 40.0, 0.0049),
            row("openvino", 20.0, 0.005),
            missing,
        ];
        let names = |rows| choice(rows).into_iter().map(|row| row.engine).collect::<Vec<_>>();
        assert_eq!(names(&rows), ["openvino_f32"]);
        assert_eq!(names(&rows[..2]), ["ort"]);
        assert!(names(&rows[3..]).is_empty());
        let alike = [row("ort", 50.0, 0.0), row("openvino_f32", 49.5, 0.0), row("rten", 52.0, 0.0)];
        assert_eq!(names(&alike), ["openvino_f32", "ort"], "their turns overlap");
    }

    #[test]
    fn the_loss_is_that_of_the_worst_group() {
        let of = |vehicle, person| {
            BTreeMap::from([("vehicle".to_owned(), vehicle), ("person".to_owned(), person)])
        };
        assert_eq!(loss(&of(0.75, 0.5), &of(0.5, 0.625)), 0.25);
        assert_eq!(loss(&of(0.75, 0.5), &of(1.0, 0.625)), -0.125);
        assert_eq!(loss(&of(0.75, 0.5), &BTreeMap::from([("vehicle".to_owned(), 0.75)])), 0.5);
    }
}
