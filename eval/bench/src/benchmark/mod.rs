//! `bench unwrap`: time and accuracy of the methods on the same frames.
//!
//! Only the call of [`Unwrap::unwrap`] into buffers of the right size is timed.

mod frames;
mod results;

use std::path::PathBuf;
use std::time::Instant;

use clap::Parser;
use modulo_core::metric::{exact_share, mse, psnr_db, quantile};
use modulo_core::unwrap::{METHODS, Options, by_name};
use modulo_core::{MAX_THREADS, Recovered, Sensor, Unwrap, UnwrapError, WorkersError, tone};
use modulo_runtime::SensorModel;
use modulo_runtime::sensor::options::SensorCommand;

use crate::{BenchError, BenchEvent, ExposureOptions, Skipped, make_folder, need, samples8, write_json};
use frames::SensedFrame;
pub use results::{BenchmarkRow, Meta, Size};

/// Name of the list of results in the folder.
pub const RESULTS: &str = "results.json";
/// Name of the file that describes the frames and the machine.
pub const META: &str = "meta.json";

/// The parameters of the sensor are options, except those of gains and mosaics: their images have methods of their own.
#[derive(Clone, Debug, PartialEq)]
pub struct WithoutPattern;

impl SensorCommand for WithoutPattern {
    fn has(parameter: &str) -> bool {
        !["gains", "gain_ratio", "mosaic"].contains(&parameter)
    }

    fn varies(parameter: &str) -> bool {
        parameter == "alpha"
    }
}

/// The settings of a benchmark, as options of a command line.
#[derive(Clone, Debug, PartialEq, Parser)]
#[command(mut_arg("alpha", |option| option.default_value("1.5,2,3,4,8")))]
pub struct BenchmarkRequest {
    /// Folder of images. Without it: eight frames of the procedural scenes, 1242 x 375
    #[arg(long, value_name = "FOLDER")]
    pub frames: Option<PathBuf>,
    /// Unwrapping methods [default: all]
    #[arg(long, value_delimiter = ',', default_values = METHODS.iter().copied(), hide_default_value = true)]
    pub method: Vec<String>,
    /// Numbers of threads
    #[arg(long, value_delimiter = ',', default_value = "1")]
    pub threads: Vec<usize>,
    /// Number of timed calls for each frame, after one call that is not timed
    #[arg(long, default_value_t = 5)]
    pub repeats: usize,
    /// The exposures.
    #[command(flatten)]
    pub exposure: ExposureOptions<WithoutPattern>,
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
    for (_, sensor) in &sensors {
        let samples = frames::sense(&files, sensor, request.exposure.seed)?;
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
    let measured = time_method(method.as_mut(), samples, request.repeats)?;
    let row = BenchmarkRow::new(request, name, threads, samples, &measured);
    if let Some(warning) = row.warning(measured.spread) {
        tell(BenchEvent::Warning(&warning));
        outcome.warnings.push(warning);
    }
    outcome.rows.push(row);
    Ok(())
}

/// Checks the request, and makes the sensor of each alpha.
fn check(request: &BenchmarkRequest) -> Result<Vec<(SensorModel, Sensor)>, BenchError> {
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
    request.exposure.sensors()
}

/// Returns the result of `work` and its duration in ms. Durations are reported, and decide nothing.
pub(crate) fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64() * 1e3)
}

/// Durations and errors of one method.
pub struct Measured {
    /// Duration of every timed call in ms, ascending.
    times: Vec<f64>,
    /// Median over frames of the interquartile range of the calls divided by their median.
    pub spread: f64,
    /// Number of samples of all frames.
    pub samples: u64,
    exact: f64,
    squares: f64,
}

/// Calls the method on each frame once to warm up buffers and caches, then `repeats` times with timing.
fn time_method(
    method: &mut dyn Unwrap,
    samples: &[SensedFrame],
    repeats: usize,
) -> Result<Measured, BenchError> {
    let mut out = Recovered::default();
    let mut all = Measured { times: Vec::new(), spread: 0.0, samples: 0, exact: 0.0, squares: 0.0 };
    let mut spreads = Vec::new();
    for sample in samples {
        // The first call on a frame can allocate buffers, and fills caches. It is not timed, but scored: all calls give
        // the same result.
        method.unwrap(&sample.modulo, sample.range, &mut out)?;
        all.score(sample, &out)?;
        let mut times = Vec::with_capacity(repeats);
        for _ in 0..repeats {
            let (unwrapped, ms) = timed(|| method.unwrap(&sample.modulo, sample.range, &mut out));
            unwrapped?;
            times.push(ms);
        }
        times.sort_by(f64::total_cmp);
        // The interquartile range of the calls on one frame shows disturbances of the machine. The spread over all
        // frames would also contain the differences between frames.
        spreads.push((at(&times, 0.75) - at(&times, 0.25)) / at(&times, 0.5).max(1e-9));
        all.times.append(&mut times);
    }
    all.times.sort_by(f64::total_cmp);
    spreads.sort_by(f64::total_cmp);
    all.spread = at(&spreads, 0.5);
    Ok(all)
}

impl Measured {
    fn score(&mut self, sample: &SensedFrame, out: &Recovered) -> Result<(), BenchError> {
        let picture = tone::picture(&out.x, sample.range, sample.transfer).map_err(UnwrapError::from)?;
        let count = sample.wraps.len() as f64;
        self.samples += sample.wraps.len() as u64;
        self.exact += count * exact_share(&out.k, &sample.wraps)?;
        self.squares += count * mse(&samples8(picture), &sample.ideal)?;
        Ok(())
    }

    /// Quantile `q` (0 to 1) of all calls by the nearest rank, ms.
    pub fn ms(&self, q: f64) -> f64 {
        at(&self.times, q)
    }

    /// Share of exact wrap counts over all frames, 0 to 1.
    pub fn exact_k(&self) -> f64 {
        // The sum consists of counts that were divided and multiplied again: rounding restores them.
        self.exact.round() / self.samples.max(1) as f64
    }

    /// PSNR of the mean squared error over all frames, dB. `None` without any error.
    pub fn psnr_db(&self) -> Option<f64> {
        psnr_db(self.squares / self.samples.max(1) as f64)
    }
}

fn at(sorted: &[f64], q: f64) -> f64 {
    quantile(sorted, q).expect("there is a frame, and each is timed at least once")
}
