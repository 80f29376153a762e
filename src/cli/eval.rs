//! Arguments of `modulo eval`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use modulo_eval::grid::GridOptions;

/// `modulo eval`
#[derive(Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Eval {
    /// Command for existing results
    #[command(subcommand)]
    pub verb: Option<Verb>,
    /// Launch file (ROS 2 YAML) with one camera. Without it: a grid over --kitti, --sequence, --yolo, --coco or
    /// --source
    pub file: Option<PathBuf>,
    /// Arguments of the launch file as name:=value
    #[arg(requires = "file")]
    pub arguments: Vec<String>,
    /// Source of frames, such as a bag or scene://PRESET: for the grid, or instead of the source in FILE (repeatable)
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
    /// With FILE: write every image that a detector gets as PNG
    #[arg(long, requires = "file")]
    pub images: bool,
    /// Also print what the nodes log, with one line for each frame
    #[arg(long, short)]
    pub verbose: bool,
    #[command(flatten)]
    pub grid: Grid,
}

/// `modulo eval VERB`
#[derive(Subcommand)]
pub enum Verb {
    /// Join the results of shards
    Merge {
        /// Folder for the joined results
        out: PathBuf,
        /// Folders of the shards
        #[arg(required = true)]
        folders: Vec<PathBuf>,
    },
    /// Draw charts and report of the results in a folder again
    Report {
        /// Folder with results.json
        folder: PathBuf,
    },
    /// Print the stream, method and model of highest accuracy within a time
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
    /// KITTI drives with tracking labels, one folder for each drive
    #[arg(long, value_name = "FOLDER", num_args = 1.., conflicts_with_all = ["file", "yolo", "coco", "source"])]
    pub sequence: Vec<PathBuf>,
    /// Folder of images with YOLO labels (subfolders images and labels, or both side by side)
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["file", "coco", "source"])]
    pub yolo: Option<PathBuf>,
    /// COCO annotation file
    #[arg(long, value_name = "JSON", conflicts_with_all = ["file", "source"])]
    pub coco: Option<PathBuf>,
    /// Folder of the images of --coco, if they are not in the usual place
    #[arg(long, value_name = "FOLDER", requires = "coco")]
    pub coco_images: Option<PathBuf>,
    /// The settings of the grid.
    #[command(flatten)]
    pub options: GridOptions,
}
