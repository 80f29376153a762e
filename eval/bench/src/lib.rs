//! The unwrapping methods on images: simulation of image files, benchmark with its chart, and the stability suite.
//!
//! Nothing here knows a node, a message or a topic: the methods are those of `modulo-core`, which the nodes use.

mod atomic_file;
pub mod benchmark;
mod error;
pub mod frontier;
pub mod simulate;
pub mod stability;
mod stopwatch;

pub use error::BenchError;

use clap::{Args, ValueEnum};
use modulo_core::{Frame, Psf, Samples, Sensor, SensorConfig};
use ndarray::Array3;
use serde::Serialize;

/// Progress of a command.
#[derive(Clone, Debug, PartialEq)]
pub enum Event<'a> {
    /// `done` of `total` steps are finished; `next` describes the next one.
    Step {
        /// Number of finished steps.
        done: usize,
        /// Number of all steps.
        total: usize,
        /// Description: file or method, and alpha.
        next: &'a str,
    },
    /// A file was skipped.
    Skipped(&'a Skipped),
    /// A measurement is uncertain.
    Warning(&'a str),
}

/// A file that was skipped.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Skipped {
    /// The file as it was given.
    pub file: String,
    /// The reason, with the name of the file.
    pub why: String,
}

/// Refuses an empty list.
fn need<T>(what: &'static str, list: &[T]) -> Result<(), BenchError> {
    if list.is_empty() { Err(BenchError::Empty(what)) } else { Ok(()) }
}

/// The simulated sensor, as options of a command line.
#[derive(Clone, Copy, Debug, PartialEq, Args)]
pub struct SensorOptions {
    /// Standard deviation of the lens blur in px. 0: a perfect lens
    #[arg(long, default_value_t = 1.4)]
    pub psf_sigma: f64,
    /// Shape of the lens blur
    #[arg(long, value_enum, default_value_t = Lens::Gaussian)]
    pub psf: Lens,
    /// Bits of the converter of the sensor
    #[arg(long, default_value_t = 8)]
    pub bits: u8,
    /// Standard deviation of the read noise in code units
    #[arg(long, default_value_t = 0.0)]
    pub read_noise: f64,
    /// Seed of the noise
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
}

/// Shape of the lens blur.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Lens {
    /// A Gaussian of --psf-sigma
    Gaussian,
    /// The fixed 7 taps of the paper (about 1.4 px)
    Paper7,
}

impl SensorOptions {
    /// The blur of the lens.
    fn psf(&self) -> Psf {
        match self.psf {
            Lens::Gaussian => Psf::of_sigma(self.psf_sigma),
            Lens::Paper7 => Psf::Paper7,
        }
    }

    /// The sensor of each alpha.
    fn sensors(&self, alphas: &[f64]) -> Result<Vec<Sensor>, BenchError> {
        need("the list of alphas", alphas)?;
        let Self { bits, read_noise, .. } = *self;
        let config = |alpha| SensorConfig { bits, alpha, psf: self.psf(), read_noise, shot_noise: 0.0 };
        alphas.iter().map(|&alpha| Ok(Sensor::new(config(alpha))?)).collect()
    }
}

/// The samples of an 8-bit image, which the metrics compare.
fn samples8(frame: Frame) -> Array3<u8> {
    match frame.into_samples() {
        Samples::U8(samples) => samples,
        Samples::U16(_) | Samples::F32(_) => unreachable!("ideal and toned pictures have 8 bits"),
    }
}
