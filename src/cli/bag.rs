//! `modulo bag`, as clap reads it.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use modulo_bags::bag::Compression;

use modulo_eval::grid::words;

/// `modulo bag`
#[derive(Subcommand)]
pub enum Bag {
    /// Record topics until SIGINT or SIGTERM
    Record(BagRecord),
    /// Replay a bag into the graph
    Play(BagPlay),
    /// Describe the content of a bag
    Info {
        /// Bag folder, or .mcap, .db3 or ROS 1 .bag file
        bag: PathBuf,
    },
    /// Copy the readable messages of a damaged bag to a new bag
    Recover(BagCopy),
    /// Convert a bag to MCAP: all of rosbag2's SQLite, images and camera calibrations of ROS 1
    Convert(BagCopy),
    /// Convert a data set to a bag
    #[command(subcommand)]
    Import(BagImport),
}

/// `modulo bag import`
#[derive(Subcommand)]
pub enum BagImport {
    /// Convert a KITTI object or sequence folder, with its labels as ground truth
    Kitti {
        /// Folder that holds image_2 or image_02
        folder: PathBuf,
        /// New bag folder
        out: PathBuf,
    },
}

/// `modulo bag recover` and `modulo bag convert`
#[derive(Args)]
pub struct BagCopy {
    /// Bag folder, or .mcap, .db3 or ROS 1 .bag file
    pub bag: PathBuf,
    /// New bag folder
    pub out: PathBuf,
    #[command(flatten)]
    pub form: Form,
}

/// `modulo bag record`
#[derive(Args)]
pub struct BagRecord {
    /// Topics to record; all topics if none is given
    #[arg(conflicts_with = "all")]
    pub topics: Vec<String>,
    /// Record all topics
    #[arg(short, long)]
    pub all: bool,
    /// New bag folder
    #[arg(short, long, value_name = "FOLDER")]
    pub output: PathBuf,
    #[command(flatten)]
    pub form: Form,
}

/// Options for writing a bag.
#[derive(Args)]
pub struct Form {
    /// Compression of the chunks
    #[arg(long, default_value = "none", value_parser = words(Compression::WORDS))]
    pub compression: Compression,
    /// Largest size of a file in bytes, before the bag continues in a new one; 0: no limit
    #[arg(short = 'b', long, value_name = "BYTES", default_value_t = 0)]
    pub max_bag_size: u64,
    /// Longest duration of a file in seconds, before the bag continues in a new one; 0: no limit
    #[arg(short = 'd', long, value_name = "SECONDS", default_value_t = 0)]
    pub max_bag_duration: u64,
}

/// `modulo bag play`
#[derive(Args)]
pub struct BagPlay {
    /// Bag folder, or .mcap, .db3 or ROS 1 .bag file
    pub bag: PathBuf,
    /// Speed; 2 is twice as fast as the recording
    #[arg(short, long, default_value_t = 1.0)]
    pub rate: f64,
    /// Start again at the end of the bag
    #[arg(short, long)]
    pub r#loop: bool,
    /// Time to skip at the start of the bag, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    pub start_offset: f64,
    /// Time to play, in seconds; the whole bag by default
    #[arg(long, value_name = "SECONDS")]
    pub playback_duration: Option<f64>,
    /// Wait for a call of the service ~/resume before the first message
    #[arg(short = 'p', long)]
    pub start_paused: bool,
    /// Publish the time of the bag on /clock, by default 40 times a second
    #[arg(long, value_name = "HZ", num_args = 0..=1, default_missing_value = "40")]
    pub clock: Option<f64>,
    /// Topics to replay; all topics by default
    #[arg(long, value_name = "TOPIC", num_args = 1..)]
    pub topics: Option<Vec<String>>,
    /// Rules from:=to that rename topics
    #[arg(long, value_name = "RULE", num_args = 1..)]
    pub remap: Vec<String>,
    /// Fully qualified names of the nodes that must be ready before the first message
    #[arg(long, value_name = "NODE", num_args = 1..)]
    pub wait_for: Vec<String>,
}
