//! `bench unwrap`: time and accuracy of the methods on the same frames.
//!
//! Only the call of [`Unwrap::unwrap`](modulo_core::Unwrap::unwrap) into buffers of the right size is timed.

mod frames;
mod results;
mod timing;

use std::path::PathBuf;

use clap::Parser;
use modulo_core::unwrap::{METHODS, Options, by_name};
use modulo_core::{MAX_THREADS, Sensor, UnwrapError, WorkersError};

use crate::{BenchError, BenchEvent, SensorOptions, Skipped, make_folder, need, write_json};
use frames::SensedFrame;
pub use results::{BenchmarkRow, Meta, Size};
pub(crate) use timing::timed;

/// Name of the list of results in the folder.
pub const RESULTS: &str = "results.json";
/// Name of the file that describes the frames and the machine.
pub const META: &str = "meta.json";

/// The settings of a benchmark, as options of a command line.
#[derive(Clone, Debug, PartialEq, Parser)]
pub struct BenchmarkRequest {
    /// Folder of images. Without it: eight frames of the procedural scenes, 1242 x 375
    #[arg(long, value_name = "FOLDER")]
    pub frames: Option<PathBuf>,
    /// Unwrapping methods [default: all]
    #[arg(long, value_delimiter = ',', default_values = METHODS.iter().copied(), hide_default_value = true)]
    pub method: Vec<String>,
    /// Saturation factors: brightest radiance divided by the peak of the sensor
    #[arg(long, value_delimiter = ',', default_value = "1.5,2,3,4,8")]
    pub alpha: Vec<f64>,
    /// Numbers of threads
    #[arg(long, value_delimiter = ',', default_value = "1")]
    pub threads: Vec<usize>,
    /// Number of timed calls for each frame, after one call that is not timed
    #[arg(long, default_value_t = 5)]
    pub repeats: usize,
    /// The sensor.
    #[command(flatten)]
    pub sensor: SensorOptions,
    /// Folder for results.json, meta.json and the charts
    #[arg(short, long, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Name of the processor, which is written into the results.
    #[arg(skip)]
    pub device: String,
}

/// Result of a benchmark.
#[derive(Clone, Debug, PartialEq)]
pub struct BenchmarkOutcome {
    /// One row for each alpha, number of threads and method. Also in [`RESULTS`].
    pub rows: Vec<BenchmarkRow>,
    /// The frames and the machine. Also in [`META`].
    pub meta: Meta,
    /// Files that could not be read.
    pub skipped: Vec<Skipped>,
    /// Warnings of uncertain measurements.
    pub warnings: Vec<String>,
}

/// Runs the benchmark. Writes [`META`], then [`RESULTS`] after every row, so that a killed run keeps its rows.
///
/// # Errors
/// [`BenchError`] before the first measurement if the request is wrong or the folder has no frame, and later if results
/// cannot be written. A frame that cannot be read is skipped.
pub fn unwrap(
    request: &BenchmarkRequest,
    tell: &mut dyn FnMut(BenchEvent<'_>),
) -> Result<BenchmarkOutcome, BenchError> {
    let sensors = check(request)?;
    make_folder(&request.out)?;
    let (files, skipped) = frames::usable(request, tell)?;
    let meta = Meta::new(request, &files);
    // Written first, so that the chart of a run that was killed has its subtitle.
    write_json(&request.out.join(META), &meta)?;
    let mut outcome = BenchmarkOutcome { rows: Vec::new(), meta, skipped, warnings: Vec::new() };
    let total = sensors.len() * request.threads.len() * request.method.len();
    // The exposures of one alpha are shared by all methods and thread counts: every row of an alpha has the same frames
    // and the same noise.
    for sensor in &sensors {
        let samples = frames::sense(&files, sensor, request.sensor.seed)?;
        for &threads in &request.threads {
            for method in &request.method {
                let next = format!("{method} alpha {} threads {threads}", sensor.range().alpha());
                tell(BenchEvent::Step { done: outcome.rows.len(), total, next: &next });
                measure(request, method, threads, &samples, &mut outcome, tell)?;
                write_json(&request.out.join(RESULTS), &outcome.rows)?;
            }
        }
    }
    Ok(outcome)
}

/// Measures one row, and warns if it is uncertain.
fn measure(
    request: &BenchmarkRequest,
    name: &str,
    threads: usize,
    samples: &[SensedFrame],
    outcome: &mut BenchmarkOutcome,
    tell: &mut dyn FnMut(BenchEvent<'_>),
) -> Result<(), BenchError> {
    let mut method = by_name(name, &Options { threads, ..Options::default() })?;
    let measured = timing::measure(method.as_mut(), samples, request.repeats)?;
    let row = BenchmarkRow::new(request, name, threads, samples, &measured);
    if let Some(warning) = row.warning(measured.spread) {
        tell(BenchEvent::Warning(&warning));
        outcome.warnings.push(warning);
    }
    outcome.rows.push(row);
    Ok(())
}

/// Checks the request, and makes the sensor of each alpha.
fn check(request: &BenchmarkRequest) -> Result<Vec<Sensor>, BenchError> {
    need("the list of methods", &request.method)?;
    need("the list of thread counts", &request.threads)?;
    if request.repeats == 0 {
        return Err(BenchError::Number { what: "repeats", value: 0, possible: "1 or more" });
    }
    for &threads in &request.threads {
        if !(1..=MAX_THREADS).contains(&threads) {
            return Err(UnwrapError::from(WorkersError::Threads { threads }).into());
        }
        // A wrong name must be refused now, and not after the methods before it were measured.
        for name in &request.method {
            by_name(name, &Options { threads, ..Options::default() })?;
        }
    }
    request.sensor.sensors(&request.alpha)
}
