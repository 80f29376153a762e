//! [`Results`]: what a grid of cells measured, as `results.json` holds it.
//!
//! Figures are fractions unless their name carries a unit. Everything but
//! [`Cell::latency_ms`] is the same on every run of the same command. Nothing is
//! computed here.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

/// Name of the file.
pub const RESULTS: &str = "results.json";
/// The same as a table, one row a cell.
pub const TABLE: &str = "results.csv";

/// `results.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// What was asked for; only results of equal setups can be put together.
    pub setup: Setup,
    /// What was looked at.
    pub input: Input,
    /// What each figure of a cell means, by its name in the cell.
    pub definitions: BTreeMap<String, String>,
    /// The cells that are done, in the order of the grid. A killed run and a shard have fewer than
    /// [`Setup::grid`].
    pub cells: Vec<Cell>,
}

/// What was asked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// Version of the program.
    pub version: String,
    /// Which protocol the frames went through.
    pub protocol: Protocol,
    /// The data, as it was given on the command line.
    pub source: String,
    /// Bits of the simulated sensor.
    pub bits: u8,
    /// Seed of noise and bootstrap.
    pub seed: u64,
    /// Objects that count in `ap50` and `ap50_95`.
    pub difficulty: Difficulty,
    /// Engine that was asked for: `auto`, `ort` or `rten`.
    pub engine: String,
    /// Class of a model to class of the labels; a class that is neither here nor among the labels' own is dropped.
    pub class_map: BTreeMap<String, String>,
    /// Class of the labels to the group it is scored in, such as `vehicle`.
    pub groups: BTreeMap<String, String>,
    /// Models by the name that cells call them, each with its sha256.
    pub models: BTreeMap<String, String>,
    /// The whole grid, all shards together, in order.
    pub grid: Vec<Point>,
}

/// What was looked at.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Input {
    /// Frames that every cell saw.
    pub frames: usize,
    /// Frames of them that somebody labelled; only these are scored.
    pub labelled: usize,
    /// Different drives among them; 0 where the data does not tell.
    pub drives: usize,
    /// sha256 over the names of the frames and their labels, hexadecimal.
    pub digest: String,
    /// What was left out, or is doubtful, a line each.
    pub warnings: Vec<String>,
    /// Classes of the labels that no model has a twin for (never found), and of the models that no label has.
    pub without_twin: BTreeMap<String, Vec<String>>,
}

/// The way of a frame to the detector.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Protocol {
    /// The suite's own nodes.
    #[default]
    Suite,
    /// What the paper's scripts did.
    Paper,
}

/// KITTI's steps of difficulty, and none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Difficulty {
    /// At least 40 px high, fully visible, at most 15 % outside the image.
    Easy,
    /// At least 25 px high, at most partly occluded, at most 30 % outside.
    #[default]
    Moderate,
    /// At least 25 px high, at most largely occluded, at most 50 % outside.
    Hard,
    /// Every label: for data sets without such steps.
    All,
}

/// What an image has to be called to be one of the four of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stream {
    /// All of the scene's range; with [`Point::psf_sigma`] 0 the sharp ideal.
    Ideal,
    /// Clipped at the peak.
    Saturated,
    /// Wrapped at the peak.
    Modulo,
    /// Unwrapped.
    Recovered,
    /// Three captures of a moving scene, one after the other, merged as a normal camera does.
    MultiExposure,
    /// The same three captures where nothing moves between them: what is left is the price of the motion.
    MultiExposureStill,
}

/// Where a cell lies in the grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// What the detector saw.
    pub stream: Stream,
    /// Unwrapping method; `None` but for [`Stream::Recovered`].
    pub method: Option<String>,
    /// Whether the lens was undone; only [`Stream::Recovered`] is.
    pub deblur: bool,
    /// Saturation factor.
    pub alpha: f64,
    /// Blur of the lens, px. Every alpha has an [`Stream::Ideal`] at 0, whatever lenses were asked for.
    pub psf_sigma: f64,
    /// Sigma of the read noise, code units.
    pub noise: f64,
    /// Name of the model in [`Setup::models`].
    pub model: String,
    /// Input size of the model: `auto`, or `WIDTHxHEIGHT`.
    pub input: String,
}

impl Stream {
    /// As in the file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ideal => "ideal",
            Self::Saturated => "saturated",
            Self::Modulo => "modulo",
            Self::Recovered => "recovered",
            Self::MultiExposure => "multi_exposure",
            Self::MultiExposureStill => "multi_exposure_still",
        }
    }
}

impl fmt::Display for Point {
    /// For people, such as `yolov10n recovered auto deblurred, alpha 4, blur 1.4 px`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { stream, method, deblur, alpha, psf_sigma, noise, model, input } = self;
        write!(f, "{model} {}", stream.name())?;
        method.iter().try_for_each(|method| write!(f, " {method}"))?;
        if *deblur {
            write!(f, " deblurred")?;
        }
        write!(f, ", alpha {alpha}, blur {psf_sigma} px")?;
        if *noise > 0.0 {
            write!(f, ", noise {noise}")?;
        }
        if input != "auto" {
            write!(f, ", {input}")?;
        }
        Ok(())
    }
}

/// One cell of the grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// Where it lies.
    #[serde(flatten)]
    pub point: Point,
    /// Frames that were scored.
    pub frames: usize,
    /// Frames of them for which no answer came; they count as frames without a detection.
    pub unanswered: usize,
    /// AP at IoU 0.5 by group (`vehicle`, `person`); `None` (`null`) where no object counts.
    pub ap50: BTreeMap<String, Option<f64>>,
    /// Mean over groups of the mean AP at IoU 0.50, 0.55, ..., 0.95.
    pub ap50_95: Option<f64>,
    /// Objects that count, by group.
    pub objects: BTreeMap<String, usize>,
    /// AP by class of the labels, classes with a twin alone.
    pub classes: BTreeMap<String, ClassScore>,
    /// AP50 by difficulty (`easy`, `moderate`, `hard`, `all`), then by group.
    pub difficulty: BTreeMap<Difficulty, BTreeMap<String, Option<f64>>>,
    /// Precision at IoU 0.5 at the recalls 0, 0.01, ..., 1, by group.
    pub precision: BTreeMap<String, Vec<f64>>,
    /// Bootstrap 95 % intervals, low and high, by figure: `ap50.vehicle`, `ap50_95`, `paper.f1`, ...
    pub interval95: BTreeMap<String, [f64; 2]>,
    /// The paper's three figures.
    pub paper: Paper,
    /// The [`WORST`] frames with labels of lowest F1, the worst first.
    pub worst: Vec<Worst>,
    /// Share of the samples whose wrap count is the true one; recovered streams alone, as what follows.
    pub exact_k: Option<f64>,
    /// Share of the frames that the method vouches for; `None` where it makes no claim.
    pub trusted: Option<f64>,
    /// PSNR against the ideal image of the same lens, dB; `None` where nothing differs.
    pub psnr_db: Option<f64>,
    /// Mean SSIM against that image.
    pub ssim: Option<f64>,
    /// PSNR against the ideal image without a lens, dB.
    pub psnr_sharp_db: Option<f64>,
    /// Mean SSIM against that image.
    pub ssim_sharp: Option<f64>,
    /// Durations by stage: `sense`, `unwrap`, `tone` or `deblur`, `pre`, `infer`, `post`, ms.
    pub latency_ms: BTreeMap<String, Percentiles>,
    /// Frames by their whole time without `sense`: (upper bound in ms, frames); empty buckets are left out.
    pub latency_histogram: Vec<(f64, u64)>,
    /// What they were measured on.
    pub device: Device,
}

/// How many frames a cell names.
pub const WORST: usize = 3;

/// A frame on which a cell did badly.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Worst {
    /// Among the frames that are scored, from 0.
    pub number: usize,
    /// As in [`Paper::f1`].
    pub f1: f64,
}

/// AP of one class.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClassScore {
    /// At IoU 0.5.
    pub ap50: f64,
    /// Mean over IoU 0.50, 0.55, ..., 0.95.
    pub ap50_95: f64,
    /// Objects that count.
    pub objects: usize,
}

/// IoU, F1 and accuracy as the paper's scripts compute them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Paper {
    /// Mean over images of the mean IoU of its true positives.
    pub iou: f64,
    /// Mean over images of F1.
    pub f1: f64,
    /// Mean over images of TP / (TP + FP + FN).
    pub accuracy: f64,
}

/// Quantiles of a stage over the frames of a cell, ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 95 % were not slower.
    pub p95: f64,
    /// 99 % were not slower.
    pub p99: f64,
}

/// What durations were measured on.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Device {
    /// The processor's own name.
    pub processor: String,
    /// The engine that really ran.
    pub engine: String,
    /// Threads of one inference.
    pub threads: usize,
    /// Frames that were worked on side by side.
    pub jobs: usize,
}
