//! `modulo bag`, as clap reads it.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use modulo_bags::bag::Compression;

use super::words;

/// `modulo bag`
#[derive(Subcommand)]
pub enum Bag {
    /// Record topics until SIGINT or SIGTERM
    Record(BagRecord),
    /// Replay a bag into the graph
    Play(BagPlay),
    /// Say what is in a bag
    Info {
        /// Bag folder, or .mcap, .db3 or ROS 1 .bag file
        bag: PathBuf,
    },
    /// Rewrite a damaged bag as far as it can be read
    Recover(BagCopy),
    /// Make an MCAP bag of any bag: rosbag2's SQLite whole, images of ROS 1
    Convert(BagCopy),
    /// Make a bag of a data set
    #[command(subcommand)]
    Import(BagImport),
}

/// `modulo bag import`
#[derive(Subcommand)]
pub enum BagImport {
    /// A KITTI object or sequence folder, with its labels as ground truth
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
    /// Topics to record, all without any
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

/// How a bag is written.
#[derive(Args)]
pub struct Form {
    /// Compression of the chunks
    #[arg(long, default_value = "none", value_parser = words(Compression::WORDS))]
    pub compression: Compression,
    /// Go on in a new file before one is larger; 0: never
    #[arg(short = 'b', long, value_name = "BYTES", default_value_t = 0)]
    pub max_bag_size: u64,
    /// Go on in a new file before one lasts longer; 0: never
    #[arg(short = 'd', long, value_name = "SECONDS", default_value_t = 0)]
    pub max_bag_duration: u64,
}

/// `modulo bag play`
#[derive(Args)]
pub struct BagPlay {
    /// Bag folder, or .mcap, .db3 or ROS 1 .bag file
    pub bag: PathBuf,
    /// Speed: 2 is twice as fast
    #[arg(short, long, default_value_t = 1.0)]
    pub rate: f64,
    /// Start again at the end
    #[arg(short, long)]
    pub r#loop: bool,
    /// Seconds to leave out at the start
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    pub start_offset: f64,
    /// Seconds of the bag to play; all without
    #[arg(long, value_name = "SECONDS")]
    pub playback_duration: Option<f64>,
    /// Wait for the service ~/resume before the first message
    #[arg(short = 'p', long)]
    pub start_paused: bool,
    /// Publish the bag's time on /clock, 40 times a second if not said otherwise
    #[arg(long, value_name = "HZ", num_args = 0..=1, default_missing_value = "40")]
    pub clock: Option<f64>,
    /// Topics to replay, all without any
    #[arg(long, value_name = "TOPIC", num_args = 1..)]
    pub topics: Option<Vec<String>>,
    /// Rename topics, from:=to
    #[arg(long, value_name = "RULE", num_args = 1..)]
    pub remap: Vec<String>,
    /// Nodes (fully qualified) that must be ready before the first message
    #[arg(long, value_name = "NODE", num_args = 1..)]
    pub wait_for: Vec<String>,
}
