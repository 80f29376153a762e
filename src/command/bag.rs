//! `modulo bag`: record, play, info, recover, import.

use std::time::Duration;

use anyhow::Context;
use modulo_bags::bag::{self, BagInfo, BagReader};
use modulo_bags::capture::capture;
use modulo_bags::import::{ImportOptions, import_kitti};
use modulo_bags::play::{PlayOptions, Player, Repeat};
use modulo_bags::record::Recorder;
use modulo_bags::replay::{replay, wait_for};
use modulo_runtime::Stop;
use modulo_runtime::signals::end_on_signals;

use super::{open_session, pairs, start_log, usage};
use crate::cli::{Bag, BagImport, BagPlay, BagRecord, Compression};
use crate::{Ended, Failure};

/// How long `--wait-for` waits.
const PATIENCE: Duration = Duration::from_secs(60);

/// Runs one of the bag commands.
pub fn bag(args: &Bag) -> Result<Ended, Failure> {
    start_log(None);
    match args {
        Bag::Record(args) => record(args),
        Bag::Play(args) => play(args),
        Bag::Info { bag } => {
            let reader = BagReader::open(bag)?;
            print!("{}", BagInfo::from(&reader));
            Ok(loss(&reader))
        }
        Bag::Recover { bag, out } => {
            let reader = BagReader::open(bag)?;
            for topic in bag::recover(&reader, out, bag::Compression::None)? {
                say!("{}: {} messages", topic.topic.name, topic.messages);
            }
            Ok(loss(&reader))
        }
        Bag::Import(BagImport::Kitti { folder, out }) => {
            let report = import_kitti(folder, out, &ImportOptions::default())?;
            say!("{} frames, {} labelled, {} objects", report.frames, report.labelled, report.objects);
            Ok(Ended::Done)
        }
    }
}

/// A bag that could not be read whole is said, and ends with exit code 3.
fn loss(reader: &BagReader) -> Ended {
    let mut ended = Ended::Done;
    for warning in reader.warnings() {
        eprintln!("modulo: {warning}");
        if warning.is_loss() {
            ended = Ended::WithLoss;
        }
    }
    ended
}

fn stop_on_signals() -> Result<Stop, Failure> {
    let stop = Stop::default();
    end_on_signals(&stop).context("signal handlers")?;
    Ok(stop)
}

fn record(args: &BagRecord) -> Result<Ended, Failure> {
    let stop = stop_on_signals()?;
    let compression = match args.compression {
        Compression::None => bag::Compression::None,
        Compression::Lz4 => bag::Compression::Lz4,
        Compression::Zstd => bag::Compression::Zstd,
    };
    let recorder = Recorder::create(&args.output, compression)?;
    let (clock, transport) = open_session()?;
    let topics = Some(args.topics.as_slice()).filter(|topics| !topics.is_empty());
    tracing::info!("recording into {}; SIGINT ends it", args.output.display());
    let captured = capture(&transport, &*clock, recorder, topics, &stop)?;
    transport.close();
    for topic in &captured.topics {
        let lost = captured.lost.get(&topic.topic.name).copied().unwrap_or(0);
        say!("{}: {} messages, {lost} lost", topic.topic.name, topic.messages);
    }
    Ok(if captured.lost.is_empty() { Ended::Done } else { Ended::WithLoss })
}

fn play(args: &BagPlay) -> Result<Ended, Failure> {
    let stop = stop_on_signals()?;
    let remaps = pairs(&args.remap)?;
    let reader = BagReader::open(&args.bag)?;
    let ended = loss(&reader);
    let start_offset = Duration::try_from_secs_f64(args.start_offset)
        .with_context(|| format!("--start-offset {}", args.start_offset))
        .map_err(usage)?;
    let options = PlayOptions {
        rate: args.rate,
        start_offset,
        repeat: if args.r#loop { Repeat::Forever } else { Repeat::Once },
        topics: args.topics.clone(),
    };
    let mut player = Player::new(reader, &options).map_err(usage)?;
    let (clock, transport) = open_session()?;
    wait_for(&transport, &*clock, &args.wait_for, PATIENCE, &stop)?;
    let sent = replay(&transport, &*clock, &mut player, &remaps, &stop)?;
    transport.close();
    for (topic, count) in sent {
        say!("{topic}: {count} messages");
    }
    Ok(ended)
}
