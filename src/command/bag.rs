//! `modulo bag`: record, play, info, recover, convert.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, anyhow};
use clap::{Args, Subcommand};
use modulo_bags::bag::{
    self, BagError, BagInfo, BagReader, BagWarning, BagWriter, Compression, WriteOptions,
};
use modulo_bags_live::LiveError;
use modulo_bags_live::capture::capture;
use modulo_bags_live::play::{PlayOptions, PlaybackClock, Player};
use modulo_bags_live::remap::TopicRemaps;
use modulo_bags_live::replay::{self, ReplayOptions, Replayed, replay};
use modulo_eval::score::words;
use modulo_middleware::driver::wait_until_ready;
use modulo_middleware::process::node_files::ReportFile;
use modulo_middleware::process::signals::end_with_launcher;
use modulo_runtime::launcher;

use super::{graph, open_session, pairs, start_log, stop_on_signals, usage};
use crate::{Ended, Failure};

/// Time limit of `--wait-for`.
const PATIENCE: Duration = Duration::from_secs(60);

#[derive(Subcommand)]
pub enum Bag {
    /// Record topics until SIGINT or SIGTERM
    Record(BagRecord),
    /// Replay a bag into the graph
    Play(BagPlay),
    /// Describe the content of a bag
    Info {
        /// Bag folder, or .mcap or .db3 file
        bag: PathBuf,
    },
    /// Copy the readable messages of a damaged bag to a new bag
    Recover(BagCopy),
    /// Convert a bag of rosbag2's SQLite to MCAP
    Convert(BagCopy),
}

#[derive(Args)]
pub struct BagCopy {
    /// Bag folder, or .mcap or .db3 file
    pub bag: PathBuf,
    /// New bag folder
    pub out: PathBuf,
    #[command(flatten)]
    pub form: Form,
}

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

#[derive(Args)]
pub struct BagPlay {
    /// Bag folder, or .mcap or .db3 file
    pub bag: PathBuf,
    /// Speed; 2 is twice as fast as the recording, 0 sends an image when the nodes have taken the last one
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

pub fn bag(args: &Bag) -> Result<Ended, Failure> {
    start_log("info");
    match args {
        Bag::Record(args) => record(args),
        Bag::Play(args) => play(args),
        Bag::Info { bag } => {
            let reader = BagReader::open(bag)?;
            say!("{}", BagInfo(&reader).to_string().trim_end());
            Ok(Ended::of(loss(reader.warnings())))
        }
        // Both copy what can be read; only the reason to call them differs.
        Bag::Recover(args) | Bag::Convert(args) => copy(&BagReader::open(&args.bag)?, args),
    }
}

fn copy(reader: &BagReader, args: &BagCopy) -> Result<Ended, Failure> {
    let copied = bag::copy(reader, &args.out, write_options(&args.form)).map_err(without_place)?;
    for topic in copied.topics {
        say!("{}: {} messages", topic.topic.name, topic.messages);
    }
    let lost = loss(reader.warnings().iter().chain(&copied.left_out));
    // What came before the break is in the new bag: the command has done its work, but not without a loss.
    copied.broke.iter().for_each(|why| note!("modulo: {why}"));
    Ok(Ended::of(lost || copied.broke.is_some()))
}

/// Tells a new bag without a place, which is a wrong command line, from an error of a run.
fn without_place(why: BagError) -> Failure {
    match why {
        BagError::Output(_) | BagError::Exists(_) | BagError::Name(_) => usage(why),
        _ => why.into(),
    }
}

fn write_options(form: &Form) -> WriteOptions {
    let max_bytes = Some(form.max_bag_size).filter(|max| *max > 0);
    let max_duration = Some(Duration::from_secs(form.max_bag_duration)).filter(|max| !max.is_zero());
    WriteOptions { compression: form.compression, max_bytes, max_duration }
}

/// Prints the warnings. Returns whether one tells of messages that cannot be read.
fn loss<'a>(warnings: impl IntoIterator<Item = &'a BagWarning>) -> bool {
    let mut lost = false;
    for warning in warnings {
        note!("modulo: {warning}");
        lost |= warning.is_loss();
    }
    lost
}

fn record(args: &BagRecord) -> Result<Ended, Failure> {
    let stop = stop_on_signals()?;
    let recorder = BagWriter::create(&args.output, write_options(&args.form)).map_err(without_place)?;
    let (clock, transport) = open_session()?;
    let topics = Some(args.topics.as_slice()).filter(|topics| !topics.is_empty());
    tracing::info!("recording into {}; SIGINT ends it", args.output.display());
    let transport = Arc::new(transport);
    let captured = capture(&transport, &clock, recorder, topics, &stop)?;
    // The session ends here, unless a question for a definition is still open, which must not delay the end.
    drop(transport);
    for topic in &captured.topics {
        // A topic without a loss has no entry.
        let lost = captured.lost.get(&topic.topic.name).copied().unwrap_or(0);
        let cut = captured.cut.get(&topic.topic.name);
        let cut =
            cut.map(|node| format!("; the link to {node} was lost, and what it sent meanwhile is missing"));
        say!("{}: {} messages, {lost} lost{}", topic.topic.name, topic.messages, cut.unwrap_or_default());
    }
    let is_there = |name: &String| {
        let name = graph::absolute(name);
        captured.topics.iter().any(|topic| topic.topic.name == name)
    };
    let missing: Vec<&str> = args.topics.iter().filter(|name| !is_there(name)).map(String::as_str).collect();
    if !missing.is_empty() {
        let missing = missing.join(", ");
        note!("modulo: no node has published {missing}; modulo topic list shows the topics of the graph");
    }
    Ok(Ended::of(!captured.lost.is_empty() || !captured.cut.is_empty() || !missing.is_empty()))
}

fn play(args: &BagPlay) -> Result<Ended, Failure> {
    let stop = stop_on_signals()?;
    let reader = BagReader::open(&args.bag).map_err(usage)?;
    let lost = loss(reader.warnings());
    let duration = args.playback_duration.map(|given| seconds("--playback-duration", given)).transpose()?;
    let options = PlayOptions {
        start_offset: seconds("--start-offset", args.start_offset)?,
        duration,
        repeats: args.r#loop,
        topics: args.topics.clone(),
    };
    // All options are checked before the session is open, so that a wrong command line never shows in the
    // graph.
    let mut player = Player::new(reader, &options).map_err(usage)?;
    let pace = PlaybackClock::new(0, args.rate, args.start_paused).map_err(usage)?;
    if let Some(hz) = args.clock.filter(|hz| !(hz.is_finite() && *hz > 0.0)) {
        return Err(usage(anyhow!("--clock {hz}: must be a finite number above 0")));
    }
    let remaps = TopicRemaps::new(pairs(&args.remap)?).map_err(usage)?;
    let options = ReplayOptions { remaps, clock_hz: args.clock };
    // A viewer that was killed cannot end its player.
    end_with_launcher(&stop).context("watch of the launcher")?;
    let (clock, transport) = open_session()?;
    wait_until_ready(&transport, &*clock, args.wait_for.clone(), PATIENCE, &stop)
        .map_err(|missing| LiveError::Waited(PATIENCE.as_secs(), missing))?;
    let Replayed { sent, unheard } = replay(&transport, &clock, &mut player, pace, &options, &stop)?;
    drop(transport);
    if let Some(folder) = launcher::folder(launcher::REPORT_DIR) {
        let report = replay::report(&sent, &player, &options);
        let file = ReportFile::create(&folder, &report.node).context("file of the player's report");
        file?.write(&report, clock.ticks_ns());
    }
    for (topic, sent) in sent {
        say!("{topic}: {} messages", sent.values().sum::<u64>());
    }
    Ok(Ended::of(left_out(&player, &unheard) || lost))
}

/// Tells what a replay has left out, and returns whether it is anything. What the bag lacks is told again, because a launcher gives the last
/// line as the reason.
fn left_out(player: &Player, unheard: &[String]) -> bool {
    player.bag.warnings().iter().filter(|w| w.is_loss()).for_each(|why| note!("modulo: {why}"));
    if !unheard.is_empty() {
        note!("modulo: no reader gets {}", unheard.join(", "));
    }
    if player.left_out > 0 {
        note!("modulo: {} messages that cannot be read were left out", player.left_out);
    }
    !unheard.is_empty() || player.left_out > 0
}

fn seconds(option: &str, given: f64) -> Result<Duration, Failure> {
    Duration::try_from_secs_f64(given).with_context(|| format!("{option} {given}")).map_err(usage)
}
