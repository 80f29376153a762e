//! `modulo bag`: record, play, info, recover, convert, import.

use std::time::Duration;

use anyhow::{Context, anyhow};
use modulo_bags::bag::{self, BagInfo, BagReader, BagWarning, BagWriter, Compression, Split, WriteOptions};
use modulo_bags::capture::capture;
use modulo_bags::import::import_kitti;
use modulo_bags::play::{PlayOptions, PlaybackClock, PlaybackState, Player, Repeat};
use modulo_bags::replay::{ReplayError, ReplayOptions, replay};
use modulo_runtime::driver::wait_until_ready;

use super::{open_session, pairs, start_log, stop_on_signals, usage};
use crate::cli::bag::{Bag, BagCopy, BagImport, BagPlay, BagRecord, Form};
use crate::{Ended, Failure};

/// Time limit of `--wait-for`.
const PATIENCE: Duration = Duration::from_secs(60);

/// Runs one of the bag commands.
pub fn bag(args: &Bag) -> Result<Ended, Failure> {
    start_log("info");
    match args {
        Bag::Record(args) => record(args),
        Bag::Play(args) => play(args),
        Bag::Info { bag } => {
            let reader = BagReader::open(bag)?;
            say!("{}", BagInfo(&reader).to_string().trim_end());
            Ok(loss(reader.warnings()))
        }
        Bag::Recover(args) => copy(&BagReader::salvage(&args.bag)?, args),
        Bag::Convert(args) => copy(&BagReader::open(&args.bag)?, args),
        Bag::Import(BagImport::Kitti { folder, out }) => {
            let report = import_kitti(folder, out, Compression::None)?;
            say!("{} frames, {} labelled, {} objects", report.frames, report.labelled, report.objects);
            Ok(Ended::Done)
        }
    }
}

fn copy(reader: &BagReader, args: &BagCopy) -> Result<Ended, Failure> {
    let copied = bag::copy(reader, &args.out, write_options(&args.form))?;
    for topic in copied.topics {
        say!("{}: {} messages", topic.topic.name, topic.messages);
    }
    let ended = loss(reader.warnings().iter().chain(&copied.left_out));
    let Some(why) = copied.broke else { return Ok(ended) };
    eprintln!("modulo: {why}");
    Ok(Ended::WithLoss)
}

fn write_options(form: &Form) -> WriteOptions {
    let max_bytes = Some(form.max_bag_size).filter(|max| *max > 0);
    let max_duration = Some(Duration::from_secs(form.max_bag_duration)).filter(|max| !max.is_zero());
    WriteOptions { compression: form.compression, split: Split { max_bytes, max_duration } }
}

/// Prints the warnings; with messages that cannot be read the exit code is 3.
fn loss<'a>(warnings: impl IntoIterator<Item = &'a BagWarning>) -> Ended {
    let mut ended = Ended::Done;
    for warning in warnings {
        eprintln!("modulo: {warning}");
        if warning.is_loss() {
            ended = Ended::WithLoss;
        }
    }
    ended
}

fn record(args: &BagRecord) -> Result<Ended, Failure> {
    let stop = stop_on_signals()?;
    let recorder = BagWriter::create(&args.output, write_options(&args.form))?;
    let (clock, transport) = open_session()?;
    let topics = Some(args.topics.as_slice()).filter(|topics| !topics.is_empty());
    tracing::info!("recording into {}; SIGINT ends it", args.output.display());
    let captured = capture(&transport, &clock, recorder, topics, &stop)?;
    transport.close();
    for topic in &captured.topics {
        let lost = captured.lost.get(&topic.topic.name).copied().unwrap_or(0);
        say!("{}: {} messages, {lost} lost", topic.topic.name, topic.messages);
    }
    Ok(if captured.lost.is_empty() { Ended::Done } else { Ended::WithLoss })
}

fn play(args: &BagPlay) -> Result<Ended, Failure> {
    let stop = stop_on_signals()?;
    let reader = BagReader::open(&args.bag)?;
    let ended = loss(reader.warnings());
    let duration = args.playback_duration.map(|given| seconds("--playback-duration", given)).transpose()?;
    let options = PlayOptions {
        start_offset: seconds("--start-offset", args.start_offset)?,
        duration,
        repeat: if args.r#loop { Repeat::Forever } else { Repeat::Once },
        topics: args.topics.clone(),
    };
    let mut player = Player::new(reader, &options).map_err(usage)?;
    let motion = if args.start_paused { PlaybackState::Paused } else { PlaybackState::Running };
    let pace = PlaybackClock::new(0, args.rate, motion).map_err(usage)?;
    if let Some(hz) = args.clock.filter(|hz| !(hz.is_finite() && *hz > 0.0)) {
        return Err(usage(anyhow!("--clock {hz}: must be a finite number above 0")));
    }
    let options = ReplayOptions { remaps: pairs(&args.remap)?, clock_hz: args.clock };
    let (clock, transport) = open_session()?;
    wait_until_ready(&transport, &*clock, args.wait_for.clone(), PATIENCE, &stop)
        .map_err(|missing| ReplayError::Waited(PATIENCE.as_secs(), missing))?;
    let sent = replay(&transport, &clock, &mut player, pace, &options, &stop)?;
    transport.close();
    for (topic, count) in sent {
        say!("{topic}: {count} messages");
    }
    if player.left_out() > 0 {
        eprintln!("modulo: {} messages that cannot be read were left out", player.left_out());
        return Ok(Ended::WithLoss);
    }
    Ok(ended)
}

fn seconds(option: &str, given: f64) -> Result<Duration, Failure> {
    Duration::try_from_secs_f64(given).with_context(|| format!("{option} {given}")).map_err(usage)
}
