//! Arguments of `modulo eval`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use modulo_detector::EngineChoice;
use modulo_eval::grid::Shard;
use modulo_eval::results::{Difficulty, Protocol, Stream};

use super::words;

/// `modulo eval`
#[derive(Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Eval {
    /// What to do with results that are there
    #[command(subcommand)]
    pub verb: Option<Verb>,
    /// Launch file (ROS 2 YAML) with one camera; without it, a grid over --kitti, --sequence, --yolo, --coco or
    /// --source
    pub file: Option<PathBuf>,
    /// Arguments of the launch file as name:=value
    #[arg(requires = "file")]
    pub arguments: Vec<String>,
    /// Source of frames: instead of the file's (several times), or the grid's: a bag, scene://PRESET
    #[arg(long, value_name = "SOURCE")]
    pub source: Vec<String>,
    /// Folder for the results
    #[arg(short, long, value_name = "FOLDER", required = true)]
    pub out: Option<PathBuf>,
    /// With FILE: write the messages on --topics into this new bag folder
    #[arg(long, value_name = "FOLDER", requires_all = ["topics", "file"])]
    pub bag: Option<PathBuf>,
    /// Topics for --bag
    #[arg(long, value_name = "TOPIC", num_args = 1.., requires = "bag")]
    pub topics: Vec<String>,
    /// With FILE: write every image that a detector saw as PNG
    #[arg(long, requires = "file")]
    pub images: bool,
    #[command(flatten)]
    pub grid: Grid,
}

/// `modulo eval VERB`
#[derive(Subcommand)]
pub enum Verb {
    /// Put the results of shards together
    Merge {
        /// Folder for the whole
        out: PathBuf,
        /// Folders of the shards
        #[arg(required = true)]
        folders: Vec<PathBuf>,
    },
    /// Draw charts and report of a folder's results.json anew
    Report {
        /// Folder with results.json
        folder: PathBuf,
    },
    /// Say which stream, method and model is the most accurate within a time
    Budget {
        /// Folder with results.json
        folder: PathBuf,
        /// Time from the captured image to the boxes, ms
        #[arg(long)]
        ms: f64,
    },
}

/// The grid of `modulo eval`.
#[derive(Args)]
#[command(next_help_heading = "Grid, without FILE")]
pub struct Grid {
    /// KITTI object folder (image_2, label_2)
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["file", "sequence", "yolo", "coco", "source"])]
    pub kitti: Option<PathBuf>,
    /// Frames of --kitti to take: a file of lines FRAME [DRIVE], or `paper` for the paper's test images
    #[arg(long, value_name = "FILE", requires = "kitti")]
    pub list: Option<PathBuf>,
    /// KITTI drives with tracking labels, each a drive of its own
    #[arg(long, value_name = "FOLDER", num_args = 1.., conflicts_with_all = ["file", "yolo", "coco", "source"])]
    pub sequence: Vec<PathBuf>,
    /// Images with YOLO labels (images and labels, or side by side)
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["file", "coco", "source"])]
    pub yolo: Option<PathBuf>,
    /// COCO annotation file
    #[arg(long, value_name = "JSON", conflicts_with_all = ["file", "source"])]
    pub coco: Option<PathBuf>,
    /// Images of --coco, where they are not found by themselves
    #[arg(long, value_name = "FOLDER", requires = "coco")]
    pub coco_images: Option<PathBuf>,
    /// The way of a frame to the detector: the suite's nodes, or what the paper's scripts did
    #[arg(long, default_value = "suite", value_parser = words([("suite", Protocol::Suite), ("paper", Protocol::Paper)]))]
    pub protocol: Protocol,
    /// What the detector sees: all of the scene's range (ideal), clipped at the peak (saturated), wrapped at the peak
    /// (modulo), unwrapped (recovered), or three captures merged, of a moving scene (multi_exposure) or of one in which
    /// nothing moves (multi_exposure_still) [default: the first four]
    #[arg(long, value_delimiter = ',', value_parser = words(STREAMS))]
    pub stream: Vec<Stream>,
    /// Unwrapping methods [default: auto,spud]
    #[arg(long, value_delimiter = ',')]
    pub method: Vec<String>,
    /// Whether the lens is undone in what was recovered
    #[arg(long, value_enum, default_value_t = Deblur::Both)]
    pub deblur: Deblur,
    /// Saturation factors
    #[arg(long, value_delimiter = ',', default_value = "1.5,2,3,4")]
    pub alpha: Vec<f64>,
    /// Sigmas of the lens blur, px
    #[arg(long, value_delimiter = ',', default_value = "1.4")]
    pub psf_sigma: Vec<f64>,
    /// Sigmas of the read noise, code units
    #[arg(long, value_delimiter = ',', default_value = "0")]
    pub noise: Vec<f64>,
    /// Detection models: ONNX files, or demo
    #[arg(long, value_delimiter = ',', default_value = "demo")]
    pub model: Vec<PathBuf>,
    /// Input sizes of the model: auto (no resizing) or WIDTHxHEIGHT [default: auto; 640x640 for the paper]
    #[arg(long, value_delimiter = ',')]
    pub input: Vec<String>,
    /// Inference engine
    #[arg(long, default_value = "auto", value_parser = words(EngineChoice::WORDS))]
    pub engine: EngineChoice,
    /// Threads of one inference
    #[arg(long, default_value_t = 1)]
    pub threads: usize,
    /// Frames worked on side by side; 0: as many as there are cores
    #[arg(long, default_value_t = 0)]
    pub jobs: usize,
    /// Seed of noise and bootstrap
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Objects that count: from 40 px and fully visible (easy), from 25 px and partly occluded (moderate), from 25 px and
    /// largely occluded (hard), or every label (all); with FILE, too [default: moderate; all for YOLO's and COCO's labels]
    #[arg(long, value_parser = words(DIFFICULTIES))]
    pub difficulty: Option<Difficulty>,
    /// File of lines `model's class: labels' class` instead of COCO to KITTI
    #[arg(long, value_name = "FILE")]
    pub class_map: Option<PathBuf>,
    /// File of lines `labels' class: group` instead of vehicle and person
    #[arg(long, value_name = "FILE")]
    pub groups: Option<PathBuf>,
    /// Work on part i of n of the cells alone
    #[arg(long, value_name = "i/n", default_value = "1/1")]
    pub shard: Shard,
}

const STREAMS: [(&str, Stream); 6] = [
    ("ideal", Stream::Ideal),
    ("saturated", Stream::Saturated),
    ("modulo", Stream::Modulo),
    ("recovered", Stream::Recovered),
    ("multi_exposure", Stream::MultiExposure),
    ("multi_exposure_still", Stream::MultiExposureStill),
];

const DIFFICULTIES: [(&str, Difficulty); 4] = [
    ("easy", Difficulty::Easy),
    ("moderate", Difficulty::Moderate),
    ("hard", Difficulty::Hard),
    ("all", Difficulty::All),
];

/// Whether the lens is undone.
#[derive(Clone, Copy, ValueEnum)]
pub enum Deblur {
    /// With and without
    Both,
    /// Always
    On,
    /// Never
    Off,
}
