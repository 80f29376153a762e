//! `bench unwrap`: time and accuracy of the methods on the same frames.
//!
//! Only [`Unwrap::unwrap`](modulo_core::Unwrap::unwrap) into buffers that fit is
//! timed; reading, sensing and scoring never are.

mod frames;
mod meta;
mod row;
mod time;

use std::path::PathBuf;

use modulo_core::unwrap::{METHODS, Options, by_name};
use modulo_core::{MAX_THREADS, Psf, Sensor, SensorConfig, UnwrapError, WorkersError};

use crate::store::{make_folder, write_json};
use crate::{Event, Skipped, StudyError, need, sensors};
use frames::Sample;
pub use meta::{Meta, Size};
pub use row::Row;

/// Name of the list of results in the folder.
pub const RESULTS: &str = "results.json";
/// Name of the file that says what they were measured on.
pub const META: &str = "meta.json";

/// What to measure.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Folder of images; `None`: eight frames of the own scenes, 1242 x 375.
    pub frames: Option<PathBuf>,
    /// Folder for the results; made when it is not there.
    pub out: PathBuf,
    /// Names of methods, as in [`METHODS`].
    pub methods: Vec<String>,
    /// Saturation factors, each in (0, 256].
    pub alphas: Vec<f64>,
    /// Blur of the lens; see [`Psf::of_sigma`].
    pub psf: Psf,
    /// Thread counts, each in 1 to [`MAX_THREADS`].
    pub threads: Vec<usize>,
    /// Timed calls for each frame, 1 or more; one call before them is not timed.
    pub repeats: usize,
    /// b, 1 to 16.
    pub bits: u8,
    /// Sigma of the read noise, code units.
    pub read_noise: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Name of the processor, for the results.
    pub device: String,
}

impl Default for Request {
    /// All methods on the own scenes: alpha 1.5, 2, 3, 4, 8, a lens of sigma 1.4 px, 8 bits, no noise, one
    /// thread, five repeats.
    fn default() -> Self {
        Self {
            frames: None,
            out: PathBuf::new(),
            methods: METHODS.iter().map(|&name| name.to_owned()).collect(),
            alphas: vec![1.5, 2.0, 3.0, 4.0, 8.0],
            psf: Psf::of_sigma(1.4),
            threads: vec![1],
            repeats: 5,
            bits: 8,
            read_noise: 0.0,
            seed: 0,
            device: String::new(),
        }
    }
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Alpha by alpha, thread count by thread count, method by method; also in [`RESULTS`].
    pub rows: Vec<Row>,
    /// What they were measured on; also in [`META`].
    pub meta: Meta,
    /// Files of the folder that could not be read or sensed.
    pub skipped: Vec<Skipped>,
    /// Measurements to be careful with.
    pub warnings: Vec<String>,
}

/// Measures, and writes [`META`], then [`RESULTS`] after every row, so that a killed run keeps what it has.
///
/// # Errors
/// [`StudyError`] before anything is measured when the request is wrong or the folder holds no frame, and
/// when results cannot be written. A frame that cannot be used is skipped.
pub fn unwrap(request: &Request, tell: &mut dyn FnMut(Event<'_>)) -> Result<Outcome, StudyError> {
    let sensors = check(request)?;
    make_folder(&request.out)?;
    let (files, skipped) = frames::usable(request, tell)?;
    let meta = Meta::new(request, &files);
    write_json(&request.out.join(META), &meta)?;
    let mut outcome = Outcome { rows: Vec::new(), meta, skipped, warnings: Vec::new() };
    let total = sensors.len() * request.threads.len() * request.methods.len();
    for sensor in &sensors {
        let samples = frames::sense(&files, sensor, request.seed)?;
        for &threads in &request.threads {
            for method in &request.methods {
                let next = format!("{method} alpha {} threads {threads}", sensor.range().alpha());
                tell(Event::Step { done: outcome.rows.len(), total, next: &next });
                measure(request, method, threads, &samples, &mut outcome, tell)?;
                write_json(&request.out.join(RESULTS), &outcome.rows)?;
            }
        }
    }
    Ok(outcome)
}

/// Adds one row, and what is to be said of it.
fn measure(
    request: &Request,
    name: &str,
    threads: usize,
    samples: &[Sample],
    outcome: &mut Outcome,
    tell: &mut dyn FnMut(Event<'_>),
) -> Result<(), StudyError> {
    let mut method = by_name(name, &Options { threads, ..Options::default() })?;
    let measured = time::measure(method.as_mut(), samples, request.repeats)?;
    let row = Row::new(request, name, threads, samples, &measured);
    if let Some(warning) = row.doubt(measured.spread) {
        tell(Event::Warning(&warning));
        outcome.warnings.push(warning);
    }
    outcome.rows.push(row);
    Ok(())
}

/// A sensor for each alpha; everything else is looked at too, so that a wrong request costs no time.
fn check(request: &Request) -> Result<Vec<Sensor>, StudyError> {
    need("the list of methods", &request.methods)?;
    need("the list of thread counts", &request.threads)?;
    if request.repeats == 0 {
        return Err(StudyError::Number { what: "repeats", value: 0, possible: "1 or more" });
    }
    for &threads in &request.threads {
        if !(1..=MAX_THREADS).contains(&threads) {
            return Err(UnwrapError::from(WorkersError::Threads { threads }).into());
        }
        for name in &request.methods {
            by_name(name, &Options { threads, ..Options::default() })?;
        }
    }
    let Request { bits, psf, read_noise, .. } = *request;
    sensors(&request.alphas, SensorConfig { bits, alpha: 1.0, psf, read_noise, shot_noise: 0.0 })
}
