//! [`Results`]: the figures of all cells, as they follow from the files of a folder; the content of `results.json`.
//!
//! Figures are fractions unless their name has a unit. Everything except durations is the same in every run of the same
//! command.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::fmt;

use modulo_ap::Difficulty;
use modulo_core::Psf;
use modulo_runtime::report::Percentiles;
use modulo_runtime::{ParameterSet as _, SensorModel, Value};
use serde::{Deserialize, Serialize};

/// Name of the file of results.
pub const RESULTS: &str = "results.json";
/// Version of the files of a folder, and of the computation of the figures. It is raised when the same command gives other figures than
/// before, so that old and new ones are never joined.
pub const FIGURES: u32 = 5;

/// The results of a grid.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// The settings. Only results of equal setups can be joined.
    pub setup: Setup,
    /// Description of the data.
    pub input: Input,
    /// The definition of each figure of a cell, by its name.
    pub definitions: BTreeMap<String, String>,
    /// Which stream finds the most, and what the figures tell from it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<String>,
    /// The cells that have been run, in the order of their settings. A part of a run has fewer cells than [`Setup::grid`].
    pub cells: Vec<Cell>,
}

impl Results {
    /// Whether frames, labels or answers are missing, or a cell has no AP because no labelled object is scored.
    pub fn lost(&self) -> bool {
        // Without any label there is nothing to score.
        let unscored = |cell: &Cell| self.input.labelled > 0 && cell.is_unscored();
        let lost = |cell: &Cell| cell.unanswered > 0 || unscored(cell);
        !self.input.warnings.is_empty() || self.cells.iter().any(lost)
    }
}

/// What all cells have in common.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// Version of the program.
    pub version: String,
    /// [`FIGURES`] of the program.
    pub figures: u32,
    /// The data, as it was given.
    pub source: String,
    /// Objects that `ap50` and `ap50_95` count.
    pub difficulty: Difficulty,
    /// Class of the model to class of the labels.
    pub class_map: BTreeMap<String, String>,
    /// Class of the labels to the group it is scored in, such as `vehicle`.
    pub groups: BTreeMap<String, String>,
    /// The sha256 of each model, by its name in cells.
    pub models: BTreeMap<String, String>,
    /// All cells in order that runs on the folder were asked for.
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

/// The streams of the suite, in the order in which they are shown.
const STREAMS: [&str; 6] = ["ideal", "saturated", "auto_exposed", "modulo", "recovered", "metered"];

/// All that decides the boxes of one cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// The image that the detector gets, such as `recovered`, or `front.auto` of the camera `front`.
    pub stream: String,
    /// Unwrapping method, or the one that the gains have. `None` for streams that are not unwrapped, but for the
    /// saturated stream of a sensor with two gains, whose pixels are merged.
    pub method: Option<String>,
    /// Whether the lens blur was removed from the recovered image.
    pub deblur: bool,
    /// The sensor. What has no effect on the stream has its default.
    #[serde(flatten, with = "modulo_runtime::parameter::flat")]
    pub sensor: SensorModel,
    /// Name of the model in [`Setup::models`].
    pub model: String,
    /// Input size of the model: `auto`, or `WIDTHxHEIGHT`.
    pub input: String,
    /// Other parameters of the nodes that differ from their defaults, as `node.parameter`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub more: BTreeMap<String, String>,
}

impl Point {
    /// Whether the stream has this name.
    pub fn is(&self, stream: &str) -> bool {
        self.stream == stream
    }

    /// Whether it is the ideal image of a lens without blur.
    pub fn is_sharp_ideal(&self) -> bool {
        self.is("ideal") && self.sensor.psf() == Psf::None
    }

    /// The order of the cells in results: models and input sizes vary slowest, then the sensor, then the stream.
    pub fn order(&self, other: &Self) -> Ordering {
        let place = |stream: &str| STREAMS.iter().position(|known| *known == stream).unwrap_or(STREAMS.len());
        let key = |point: &Self| (point.model.clone(), point.input.clone(), point.more.clone());
        let image =
            |point: &Self| (place(&point.stream), point.stream.clone(), point.method.clone(), point.deblur);
        let sensor = || {
            let [own, others] = [self, other].map(|point| point.sensor.declared());
            // The lens varies with the streams: the sharp ideal image belongs to all lenses.
            let slow = own.iter().zip(&others).filter(|((parameter, _), _)| parameter.name != "psf_sigma");
            let slow = slow.map(|((_, a), (_, b))| compare(a, b));
            slow.fold(Ordering::Equal, Ordering::then)
        };
        let lens = self.sensor.psf_sigma.total_cmp(&other.sensor.psf_sigma);
        key(self).cmp(&key(other)).then_with(sensor).then(lens).then_with(|| image(self).cmp(&image(other)))
    }

    /// The description of the cell as the name of a file without its extension.
    pub fn file_name(&self) -> String {
        file_name(&self.to_string())
    }
}

fn compare(one: &Value, other: &Value) -> Ordering {
    match (one, other) {
        (Value::Double(one), Value::Double(other)) => one.total_cmp(other),
        (Value::Integer(one), Value::Integer(other)) => one.cmp(other),
        _ => one.plain().cmp(&other.plain()),
    }
}

impl fmt::Display for Point {
    /// Describes the cell, such as `yolov10n recovered auto deblurred, alpha 4, blur 1.4 px`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { stream, method, deblur, sensor, model, input, more } = self;
        write!(f, "{model} {stream}")?;
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
        more.iter().try_for_each(|(name, value)| write!(f, ", {name} {value}"))
    }
}

/// A cell, the frames that it sees, and the file of its model.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CellKey {
    /// The stream and its settings.
    pub point: Point,
    /// The camera and how its images are read, as in the names of the files of frames.
    pub frames: String,
    /// sha256 of the model, hexadecimal.
    pub model: String,
}

/// The figures of one cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// The settings of the cell.
    #[serde(flatten)]
    pub point: Point,
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
    /// Bounds of the 95 % bootstrap interval by figure: `ap50`, `ap50.vehicle`, ...
    pub interval95: BTreeMap<String, [f64; 2]>,
    /// Share of the samples with the true wrap count. This and the next three figures exist only for recovered streams.
    pub exact_k: Option<f64>,
    /// Share of the frames in which all samples have the true wrap count.
    pub exact_frames: Option<f64>,
    /// Share of the frames that the method trusts. `None` if it makes no statement.
    pub trusted: Option<f64>,
    /// Number of frames that the method trusts although less than 99.9 % of the samples have the true wrap count.
    pub trusted_wrong: Option<usize>,
    /// PSNR against the ideal image of the same lens, dB; infinite (`"inf"` in JSON) for equal images. This and the next figures
    /// exist for recovered and saturated streams.
    #[serde(with = "psnr")]
    pub psnr_db: Option<f64>,
    /// Mean SSIM against that image.
    pub ssim: Option<f64>,
    /// PSNR against the ideal image without a lens, dB.
    #[serde(with = "psnr")]
    pub psnr_sharp_db: Option<f64>,
    /// Mean SSIM against that image.
    pub ssim_sharp: Option<f64>,
    /// Objects of classes or groups that the model does not know, and that are not scored.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub unknown: BTreeMap<String, usize>,
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

/// The times of a cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CellTimes {
    /// Durations of each stage.
    pub latency_ms: BTreeMap<String, Percentiles>,
    /// Time of a frame.
    pub frame_ms: FrameTime,
    /// The machine and the settings.
    pub device: Device,
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
    /// The pass that measured it. Only times of one pass can be compared.
    pub pass: String,
}

impl Cell {
    /// Takes the times that were measured last.
    pub(crate) fn take_times(&mut self, times: CellTimes) {
        let CellTimes { latency_ms, frame_ms, device } = times;
        (self.latency_ms, self.frame_ms, self.device) = (latency_ms, Some(frame_ms), device);
    }

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

/// A text as part of a file name, with its words separated by `_`.
pub(crate) fn file_name(name: &str) -> String {
    let words = name.split(|c: char| !c.is_ascii_alphanumeric() && !".-".contains(c));
    words.filter(|word| !word.is_empty()).collect::<Vec<_>>().join("_")
}
