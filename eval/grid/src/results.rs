//! [`Results`]: the content of `results.json`.
//!
//! Figures are fractions unless their name has a unit. Everything except durations is the same in every run of the same
//! command.

use std::collections::BTreeMap;
use std::fmt;

use clap::ValueEnum;
use modulo_ap::Difficulty;
use modulo_runtime::report::Percentiles;
use modulo_runtime::{ParameterSet as _, SensorModel};
use serde::{Deserialize, Serialize};

use crate::chart::file_name;

/// Name of the file of results.
pub const RESULTS: &str = "results.json";
/// Name of the folder with a file for each cell, which has a line for each of its frames.
pub const FRAMES: &str = "frames";

/// Version of the computation of the figures. It is raised when the same request gives other figures than before, so that
/// old and new ones are never joined.
pub const FIGURES: u32 = 4;

/// The results of a grid.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// The settings. Only results of equal setups can be joined.
    pub setup: Setup,
    /// Description of the data.
    pub input: Input,
    /// The definition of each figure of a cell, by its name.
    pub definitions: BTreeMap<String, String>,
    /// The finished cells in the order of the grid. A killed run has fewer cells than [`Setup::grid`].
    pub cells: Vec<Cell>,
    /// The runs that made the cells, the first one first.
    pub runs: Vec<Provenance>,
}

/// Where, when and by which command results were made.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// The command line.
    pub command: String,
    /// Commit of the program.
    pub commit: String,
    /// Name of the machine.
    pub host: String,
    /// Name of the processor.
    pub processor: String,
    /// Time of the start, such as `2026-11-22T10:00:00Z`.
    pub started: String,
    /// Mean number of running processes in the minute before the start. `None` where the system does not tell it.
    pub load: Option<f64>,
    /// Wall time of the run without its report, s. `None` if the run was killed.
    pub wall_s: Option<f64>,
}

impl Provenance {
    /// Names the pass in which this run measures times.
    pub fn pass(&self) -> String {
        format!("{} {}", self.host, self.started)
    }
}

impl Results {
    /// Whether the cell at `point` is finished.
    pub fn has(&self, point: &Point) -> bool {
        self.cells.iter().any(|cell| cell.point == *point)
    }

    /// Number of the finished cells that are not among `points`.
    pub fn others(&self, points: &[Point]) -> usize {
        self.cells.iter().filter(|cell| !points.contains(&cell.point)).count()
    }

    /// Whether frames, labels or answers are missing, or a cell has no AP because no labelled object is scored.
    pub fn lost(&self) -> bool {
        let lost = |cell: &Cell| cell.unanswered > 0 || cell.is_unscored();
        !self.input.warnings.is_empty() || self.cells.iter().any(lost)
    }
}

/// The settings of a grid.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// Version of the program.
    pub version: String,
    /// [`FIGURES`] of the program.
    pub figures: u32,
    /// The protocol of the pipelines.
    pub protocol: Protocol,
    /// The data, as it was given on the command line.
    pub source: String,
    /// Bits of the simulated sensor.
    pub bits: u8,
    /// Seed of noise and bootstrap.
    pub seed: u64,
    /// Objects that `ap50` and `ap50_95` count.
    pub difficulty: Difficulty,
    /// The requested engine, such as `auto`; on a GPU with the device, such as `ort on cuda:0`.
    pub engine: String,
    /// Class of the model to class of the labels.
    pub class_map: BTreeMap<String, String>,
    /// Class of the labels to the group it is scored in, such as `vehicle`.
    pub groups: BTreeMap<String, String>,
    /// The sha256 of each model, by its name in cells.
    pub models: BTreeMap<String, String>,
    /// All cells in order, over all grids that were run on the folder.
    pub grid: Vec<Point>,
}

/// The data of a grid.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Input {
    /// Number of frames.
    pub frames: usize,
    /// Number of labelled frames. Only these are scored.
    pub labelled: usize,
    /// Number of drives. 0 if the data does not name them.
    pub drives: usize,
    /// The units that the bootstrap of the intervals draws. `None` before it has drawn.
    pub drawn: Option<Drawn>,
    /// sha256 over the names, the labels and the pixels of the frames, hexadecimal.
    pub digest: String,
    /// One line for each kind of frame or label that was left out or changed.
    pub warnings: Vec<String>,
    /// Classes without a counterpart: of the labels, for each model, and of each model.
    pub without_twin: BTreeMap<String, Vec<String>>,
}

/// The units that the bootstrap of the intervals draws, with their number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Drawn {
    /// Whole drives
    Drives(usize),
    /// Single frames
    Frames(usize),
}

impl fmt::Display for Drawn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Drives(count) => write!(f, "{count} drives"),
            Self::Frames(count) => write!(f, "{count} frames"),
        }
    }
}

/// Number of drives below which an interval is too narrow to rely on.
const ENOUGH_DRIVES: usize = 10;

impl Input {
    /// A warning about intervals whose units are few, or known to depend on each other.
    pub fn interval_warning(&self) -> Option<String> {
        let few = match self.drawn? {
            Drawn::Drives(count) if count < ENOUGH_DRIVES => format!("only {count} drives"),
            // Frames are drawn although drives are known: frames of one drive are near duplicates.
            Drawn::Frames(count) if (1..ENOUGH_DRIVES).contains(&self.drives) => {
                format!("{count} frames, many of them of the same drive")
            }
            _ => return None,
        };
        Some(format!(
            "the 95 % intervals come from {few} and are too narrow; take at least {ENOUGH_DRIVES} drives"
        ))
    }
}

/// The pipeline from a frame to the detector.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Protocol {
    /// The nodes of the suite
    #[default]
    Suite,
    /// The steps of the scripts of the paper
    Paper,
}

/// The image that the detector gets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum Stream {
    /// The full range of the scene
    #[default]
    Ideal,
    /// Clipped at the peak
    Saturated,
    /// A normal camera whose exposure follows the frames before
    AutoExposed,
    /// Wrapped at the peak
    Modulo,
    /// Unwrapped
    Recovered,
    /// Unwrapped, and shown with the exposure that the frame itself asks for
    Metered,
    /// Three consecutive captures of a moving scene, merged as a normal camera does
    MultiExposure,
    /// The same three captures of a scene in which nothing moves; the difference is the effect of motion
    MultiExposureStill,
}

/// The settings of one cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// The image that the detector gets.
    pub stream: Stream,
    /// Unwrapping method, or the one that the gains have. `None` for streams that are not unwrapped, but for the
    /// saturated stream of a sensor with two gains, whose pixels are merged.
    pub method: Option<String>,
    /// Whether the lens blur was removed. Only for [`Stream::Recovered`].
    pub deblur: bool,
    /// The sensor. Every alpha also has a sharp [`Stream::Ideal`], whose `psf_sigma` is 0.
    #[serde(flatten, with = "modulo_runtime::parameter::flat")]
    pub sensor: SensorModel,
    /// Name of the model in [`Setup::models`].
    pub model: String,
    /// Input size of the model: `auto`, or `WIDTHxHEIGHT`.
    pub input: String,
}

impl Stream {
    /// Those of the scripts of the paper, in the order of the paper.
    pub const OF_PAPER: [Self; 4] = [Self::Ideal, Self::Saturated, Self::Modulo, Self::Recovered];

    /// Whether its images are unwrapped.
    pub fn is_unwrapped(self) -> bool {
        matches!(self, Self::Recovered | Self::Metered)
    }

    /// Whether its exposure is metered.
    pub fn is_metered(self) -> bool {
        matches!(self, Self::Metered | Self::AutoExposed)
    }

    /// Whether an image depends on the frames before it.
    pub fn follows_frames(self) -> bool {
        self == Self::AutoExposed
    }

    /// The name in results and options.
    pub fn name(self) -> String {
        self.to_possible_value().expect("no stream is hidden").get_name().to_owned()
    }
}

impl Point {
    /// The description of the cell as the name of a file without its extension.
    pub fn file_name(&self) -> String {
        file_name(&self.to_string())
    }
}

impl fmt::Display for Point {
    /// Describes the cell, such as `yolov10n recovered auto deblurred, alpha 4, blur 1.4 px`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { stream, method, deblur, sensor, model, input } = self;
        write!(f, "{model} {}", stream.name())?;
        method.iter().try_for_each(|method| write!(f, " {method}"))?;
        if *deblur {
            write!(f, " deblurred")?;
        }
        write!(f, ", alpha {}, blur {} px", sensor.alpha, sensor.psf_sigma)?;
        for (parameter, value) in sensor.declared() {
            // The gains have a method of their own, which is named.
            let named = ["alpha", "psf_sigma", "gains"].contains(&parameter.name);
            if !named && value != parameter.default {
                write!(f, ", {} {}", parameter.name.replace('_', " "), value.plain())?;
            }
        }
        if input != "auto" {
            write!(f, ", {input}")?;
        }
        Ok(())
    }
}

/// The figures of one cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// The settings of the cell.
    #[serde(flatten)]
    pub point: Point,
    /// Name of the file with the frames of the cell, without its extension.
    #[serde(default)]
    pub name: String,
    /// Number of scored frames.
    pub frames: usize,
    /// Number of frames without an answer. They are scored as frames without a detection.
    pub unanswered: usize,
    /// AP at IoU 0.5 of each group (`vehicle`, `person`). `None` (`null`) if no object is scored.
    pub ap50: BTreeMap<String, Option<f64>>,
    /// Mean over the groups of the mean AP at IoU 0.50, 0.55, ..., 0.95.
    pub ap50_95: Option<f64>,
    /// Number of scored objects of each group.
    pub objects: BTreeMap<String, usize>,
    /// AP of each class of the labels that the model can find.
    pub classes: BTreeMap<String, ClassScore>,
    /// AP50 for each difficulty (`easy`, `moderate`, `hard`, `all`) and group.
    pub difficulty: BTreeMap<Difficulty, BTreeMap<String, Option<f64>>>,
    /// Bounds of the 95 % bootstrap interval by figure: `ap50.vehicle`, `paper.f1`, ...
    pub interval95: BTreeMap<String, [f64; 2]>,
    /// Share of the frames whose nearest object is found, of those with an object that counts. `None` without one.
    #[serde(default)]
    pub nearest: Option<f64>,
    /// The accuracy around the changes of the light, if it changes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub moments: Vec<Moment>,
    /// The three figures of the paper.
    pub paper: Paper,
    /// Share of the samples with the true wrap count. This and the next three figures exist only for recovered streams.
    pub exact_k: Option<f64>,
    /// Share of the frames in which all samples have the true wrap count.
    pub exact_frames: Option<f64>,
    /// Share of the frames that the method trusts. `None` if it makes no statement.
    pub trusted: Option<f64>,
    /// Number of frames that the method trusts although less than 99.9 % of the samples have the true wrap count.
    pub trusted_wrong: Option<usize>,
    /// PSNR against the ideal image of the same lens, dB; infinite (`"inf"` in JSON) for equal images. This and the next figures
    /// exist for recovered, merged and saturated streams.
    #[serde(with = "psnr")]
    pub psnr_db: Option<f64>,
    /// Mean SSIM against that image.
    pub ssim: Option<f64>,
    /// PSNR against the ideal image without a lens, dB.
    #[serde(with = "psnr")]
    pub psnr_sharp_db: Option<f64>,
    /// Mean SSIM against that image.
    pub ssim_sharp: Option<f64>,
    /// Durations of each stage: `sense`, `unwrap`, `tone` or `deblur`, `pre`, `infer`, `post`, ms.
    pub latency_ms: BTreeMap<String, Percentiles>,
    /// Time of a frame from the captured image to the boxes, without `sense`. `None` if it was not measured.
    pub frame_ms: Option<FrameTime>,
    /// The machine and the settings of the durations.
    pub device: Device,
}

/// A PSNR in JSON, which has no infinite numbers: a number, `"inf"`, or `null` for none.
mod psnr {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};
    use serde_json::Value;

    pub fn serialize<S: Serializer>(value: &Option<f64>, to: S) -> Result<S::Ok, S::Error> {
        if *value == Some(f64::INFINITY) { to.serialize_str("inf") } else { value.serialize(to) }
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
        match Value::deserialize(from)? {
            Value::Null => Ok(None),
            Value::String(word) if word == "inf" => Ok(Some(f64::INFINITY)),
            other => other.as_f64().map(Some).ok_or_else(|| {
                let word = other.to_string();
                let word = word.trim_matches('"');
                D::Error::custom(format!("a PSNR is '{word}', but must be a number or inf"))
            }),
        }
    }
}

/// Time of a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameTime {
    /// Median wall-clock time, ms.
    pub p50: f64,
    /// Bounds of the 95 % interval of the median, ms.
    pub interval95: [f64; 2],
    /// Median processor time of all threads, ms.
    pub cpu_ms: f64,
    /// Number of frames.
    pub frames: usize,
    /// The pass that measured it, see [`Provenance::pass`]. Only times of one pass can be compared.
    pub pass: String,
}

impl Cell {
    /// AP50 of a group, 0 to 1.
    pub fn ap50_of(&self, group: &str) -> Option<f64> {
        *self.ap50.get(group)?
    }

    /// The bounds of the 95 % interval of this AP50.
    pub fn interval_of(&self, group: &str) -> Option<[f64; 2]> {
        self.interval95.get(&format!("ap50.{group}")).copied()
    }

    /// Whether no labelled object is scored.
    pub fn is_unscored(&self) -> bool {
        self.ap50.values().all(Option::is_none)
    }
}

/// The accuracy at some time before or after the changes of the light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Moment {
    /// Whether the light gets darker, or else brighter.
    pub is_darker: bool,
    /// The first frame of the moment, counted from the first frame of the change.
    pub frame: i64,
    /// Number of frames, over all changes of all drives.
    pub frames: usize,
    /// Mean over the groups of AP at IoU 0.5.
    pub ap50: Option<f64>,
    /// Share of the frames whose nearest object is found.
    pub nearest: Option<f64>,
}

/// AP of one class.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClassScore {
    /// AP at IoU 0.5.
    pub ap50: f64,
    /// Mean AP over IoU 0.50, 0.55, ..., 0.95.
    pub ap50_95: f64,
    /// Number of scored objects.
    pub objects: usize,
}

/// IoU, F1 and accuracy as the paper's scripts compute them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Paper {
    /// Mean over images of the mean IoU of their true positives.
    pub iou: f64,
    /// Mean over images of F1.
    pub f1: f64,
    /// Mean over images of TP / (TP + FP + FN).
    pub accuracy: f64,
}

/// The machine and the settings that durations were measured with.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Device {
    /// Name of the processor.
    pub processor: String,
    /// The engine in use.
    pub engine: String,
    /// Threads of one inference.
    pub threads: usize,
}
