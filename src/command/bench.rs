//! `modulo bench`.

use std::net::{Ipv4Addr, TcpListener};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use modulo_bags::source::{self, SourceOptions};
use modulo_bench::engines::{EngineFigures, EngineOutcome, EngineRow, EnginesRequest};
use modulo_bench::{BenchError, BenchEvent, below_100, engines, pipeline};
use modulo_detector::{EngineChoice, EngineOptions, embedded, measure};
use modulo_launch::launch_file;
use modulo_middleware::transport::zenoh::meeting_port;
use modulo_runtime::SystemClock;
use modulo_runtime::clock::monotonic_ns;

use super::eval::LabelledFrames;
use super::usage;
use crate::{Ended, Failure};

/// A side of the detector's input is a multiple of this, px.
const STRIDE: usize = 32;
/// Number of runs of the network by itself before and after each run of the pipeline.
const BARE_RUNS: NonZeroUsize = NonZeroUsize::new(20).expect("not zero");

#[derive(Subcommand)]
pub enum Bench {
    /// Measure the time from the modulo image to the boxes in one process and in several, beside that of the network by itself
    Pipeline(pipeline::PipelineRequest),
    /// Measure the accuracy, the time and the memory of the inference engines of this machine, and name the fastest one that loses less
    /// than 0.5 points of AP50
    Detector(DetectorBench),
}

#[derive(Args)]
pub struct DetectorBench {
    #[command(flatten)]
    labelled: LabelledFrames,
    /// Source of labelled frames, such as a bag or scene://PRESET; used without --kitti, --sequence, --yolo or --coco
    #[arg(long, value_name = "SOURCE", default_value = "scene://day?seed=3&frames=20&width=640&height=192")]
    source: String,
    #[command(flatten)]
    request: EnginesRequest,
}

/// Measures what runs the program.
pub fn bench(command: &Bench) -> Result<Ended, Failure> {
    match command {
        Bench::Pipeline(request) => bench_pipeline(request),
        Bench::Detector(args) => bench_detector(args),
    }
}

fn bench_pipeline(request: &pipeline::PipelineRequest) -> Result<Ended, Failure> {
    let mut engines = EngineChoice::WORDS.into_iter();
    let engine = engines.find(|(word, _)| *word == request.engine);
    let options = EngineOptions {
        engine: engine.expect("the option takes these words only").1,
        device: request.device.parse().map_err(|why: String| usage(anyhow!(why)))?,
        threads: 0,
    };
    let mut source = source::open(&request.frames, &SourceOptions::default()).map_err(usage)?;
    let first = source.next().context("the source has no frame")?.map_err(anyhow::Error::from)?;
    let (height, width, _) = first.radiance.dim();
    let size = [(height.next_multiple_of(STRIDE), width.next_multiple_of(STRIDE))];
    let clock = SystemClock::default();
    let mut bare = |period| {
        let speeds = measure(Path::new(&request.model), options, &size, (BARE_RUNS, period), &clock);
        let speeds = speeds.map_err(|why| BenchError::Run(why.to_string()))?;
        Ok(speeds[0].durations_ns.iter().map(|&ns| ns as f64 / 1e6).collect())
    };
    let launch_file = &launch_file("recovered".as_ref()).map_err(usage)?;
    let (program, now_ns) = (&this_program()?, monotonic_ns);
    let (domain, _lock) = free_domain()?;
    let mut bench = pipeline::PipelineBench { program, launch_file, domain, now_ns, bare: &mut bare };
    let load = load();
    let rows = with_bar(tell_long, |tell| pipeline::pipeline(request, &mut bench, tell))?;
    say!("{load}");
    print_pipeline(&rows);
    Ok(Ended::Done)
}

/// Takes a ROS domain for as long as the listener lives. It is neither the default of a suite nor one of a test, and the domain of nobody
/// who runs now: a benchmark listens 300 ports below the port where the nodes of its domain meet.
fn free_domain() -> Result<(u32, TcpListener), Failure> {
    let listen = |port| TcpListener::bind((Ipv4Addr::LOCALHOST, port)).ok();
    let take = |domain| {
        let lock = listen(meeting_port(domain) - 300)?;
        listen(meeting_port(domain)).map(|_| (domain, lock))
    };
    let found = (70..100).rev().find_map(take);
    found.ok_or_else(|| {
        anyhow!("the ROS domains 70 to 99 are all in use: end what runs in one of them").into()
    })
}

/// Prints a line for each way to run the suite, and its stages.
fn print_pipeline(rows: &[pipeline::PipelineRow]) {
    say!(
        "mode      engine   frames    p50 ms    p99 ms   bare ms    ratio  frames/s  first box s  cpu s/frame    rss MB"
    );
    for row in rows {
        say!(
            "{:<9} {:<8} {:>6} {:>9.2} {:>9.2} {:>9.2} {:>8.3} {:>9.2} {:>12} {:>12.3} {:>9.1}",
            format!("{:?}", row.mode).to_lowercase(),
            row.engine,
            row.frames,
            row.p50_ms,
            row.p99_ms,
            row.bare_p50_ms,
            row.p50_ms / row.bare_p50_ms,
            row.frames_per_s,
            row.first_box_s.map_or("-".into(), |s| format!("{s:.2}")),
            row.cpu_s_per_frame,
            row.rss_mb
        );
        let stages = row.stage_ms.iter().map(|(name, ms)| format!("{name} {ms:.2}"));
        say!("          {}", stages.collect::<Vec<_>>().join(", "));
    }
}

pub(super) fn this_program() -> Result<PathBuf, Failure> {
    Ok(std::env::current_exe().context("this program")?)
}

fn bench_detector(args: &DetectorBench) -> Result<Ended, Failure> {
    let DetectorBench { labelled, source, request } = args;
    // A later one that is missing would be known only when those before it were measured.
    for model in request.model.iter().filter(|model| embedded(Path::new(model)).is_none()) {
        std::fs::metadata(model).with_context(|| format!("model {model}")).map_err(usage)?;
    }
    let mut options = labelled.options();
    if options.is_empty() {
        options = vec!["--source".into(), source.into()];
    }
    let load = load();
    let program = this_program()?;
    let rows = with_bar(tell_long, |tell| engines::engines(request, &options, &program, tell))?;
    say!("{load}");
    print_engines(&rows);
    Ok(Ended::Done)
}

/// Prints a line for each engine, and the fastest of them.
fn print_engines(rows: &[EngineRow]) {
    say!(
        "engine        device    p50 ms    p99 ms  memory MB  loss of AP50  AP50 with its 95 % interval; model"
    );
    for row in rows {
        let name = format!("{:<13} {:<8}", row.engine, row.device);
        match &row.outcome {
            EngineOutcome::Measured(figures) => say!(
                "{name} {:>7.2} {:>9.2} {:>10.0} {:>13.2}  {}; {}",
                figures.p50_ms,
                figures.p99_ms,
                figures.rss_mb,
                100.0 * figures.loss,
                accuracy(figures),
                row.model
            ),
            EngineOutcome::Missing(why) => say!("{name} {why}; {}", row.model),
        }
    }
    let all = engines::choice(rows).into_iter().map(EngineRow::arguments).collect::<Vec<_>>();
    match &*all {
        [] => {}
        [one] => say!("The fastest that loses less than 0.5 points of AP50: {one}"),
        several => say!("No clear winner, since the times of two turns overlap: {}", several.join("; ")),
    }
}

/// The AP50 of each group in percent, with its interval.
fn accuracy(figures: &EngineFigures) -> String {
    let group = |(group, &ap): (&String, &f64)| {
        let bounds = figures.interval95.get(group);
        let bounds = bounds.map_or(String::new(), |bounds| {
            format!(" [{}]", bounds.map(|bound| below_100(bound, 1)).join(", "))
        });
        format!("{group} {}{bounds}", below_100(ap, 1))
    };
    figures.ap50.iter().map(group).collect::<Vec<_>>().join(", ")
}

/// Tells an error of the command line from one of a file or of the run.
fn failure(why: BenchError) -> Failure {
    match why {
        BenchError::Request(_) | BenchError::Output(_) => usage(why),
        _ => why.into(),
    }
}

/// The model of the processor from `/proc/cpuinfo`, or its architecture.
pub fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    match model {
        Some((_, name)) => name.split_whitespace().collect::<Vec<_>>().join(" "),
        None => std::env::consts::ARCH.to_owned(),
    }
}

/// How busy the machine is before a measurement.
fn load() -> String {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load = load.split(' ').next().filter(|load| !load.is_empty()).unwrap_or("unknown");
    format!("{}, {cores} cores, load of other programs {load}", processor())
}

/// A progress bar in the form of `template`, which is shown only on a terminal.
pub fn progress_bar(template: &str) -> ProgressBar {
    ProgressBar::new(0).with_style(style(template))
}

pub fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("the templates of this program are valid")
}

/// Runs `work` with a progress bar, on which `tell` shows its events.
pub fn with_bar<T>(
    tell: fn(&ProgressBar, BenchEvent<'_>),
    work: impl FnOnce(&mut dyn FnMut(BenchEvent<'_>)) -> Result<T, BenchError>,
) -> Result<T, Failure> {
    let bar = progress_bar("{bar:30} {pos}/{len} {eta} {msg}");
    let done = work(&mut |event| tell(&bar, event)).map_err(failure)?;
    bar.finish_and_clear();
    Ok(done)
}

/// Shows the progress of long work as [`tell`] does. Without a terminal, it prints up to twenty lines in place of the bar.
fn tell_long(bar: &ProgressBar, event: BenchEvent<'_>) {
    if let BenchEvent::Step { done, total, next } = event
        && bar.is_hidden()
        && done % total.div_ceil(20) == 0
    {
        note!("modulo: {done} of {total} done, next: {next}");
    }
    tell(bar, event);
}

/// Shows the progress on the bar, and writes warnings to standard error.
pub fn tell(bar: &ProgressBar, event: BenchEvent<'_>) {
    match event {
        BenchEvent::Step { done, total, next } => {
            bar.set_length(total as u64);
            bar.set_position(done as u64);
            bar.set_message(next.to_owned());
        }
        // A line that is printed while a bar is drawn would tear it apart, so the bar is taken away
        // meanwhile.
        BenchEvent::Warning(warning) => bar.suspend(|| note!("modulo: {warning}")),
    }
}
