//! `modulo bench`.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use clap::Subcommand;
use indicatif::{ProgressBar, ProgressStyle};
use modulo_bench::{BenchError, BenchEvent, stability};
use modulo_core::{SensorError, UnwrapError, WorkersError};
use modulo_images::ImageError;
use modulo_runtime::output::ResultFolder;

use super::usage;
use crate::{Ended, Failure};

#[derive(Subcommand)]
pub enum Bench {
    /// Run every unwrapping method on scenes that are hard to unwrap, and write a report
    Stability {
        /// Folder for index.html, results.json and the pictures; without it a new one in runs
        #[arg(short, long, value_name = "FOLDER")]
        out: Option<PathBuf>,
    },
}

/// Measures what runs the program.
pub fn bench(command: &Bench) -> Result<Ended, Failure> {
    match command {
        Bench::Stability { out } => bench_stability(out.as_deref()),
    }
}

pub(super) fn this_program() -> Result<PathBuf, Failure> {
    Ok(std::env::current_exe().context("this program")?)
}

/// Tells an error of the command line from one of a file or of the run.
fn failure(why: BenchError) -> Failure {
    let of_command_line = match &why {
        BenchError::Request(_)
        | BenchError::Output(_)
        | BenchError::NotCodes(..)
        | BenchError::Parameter(_)
        | BenchError::Video(_)
        | BenchError::Image(ImageError::Coding(..)) => true,
        BenchError::Sensor(why) => !matches!(why, SensorError::Shape(_) | SensorError::NotFinite(..)),
        BenchError::Unwrap(UnwrapError::Method { .. } | UnwrapError::Workers(WorkersError::Threads(_))) => {
            true
        }
        _ => false,
    };
    if of_command_line { usage(why) } else { why.into() }
}

fn bench_stability(out: Option<&Path>) -> Result<Ended, Failure> {
    let folder = ResultFolder::take(out, "stability", None).map_err(usage)?;
    let out = folder.path();
    let outcome = with_bar(tell_long, |tell| stability::run(out, tell))?;
    outcome.better.iter().for_each(|what| say!("better than documented: {what}"));
    outcome.broken.iter().for_each(|what| say!("broken: {what}"));
    let (held, broken) = (outcome.held, outcome.broken.len());
    say!("{held} expectations held, {broken} broke");
    say!("{}", out.join("index.html").display());
    if broken > 0 { Err(anyhow!("{broken} expectations broke").into()) } else { Ok(Ended::Done) }
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
