//! Arguments of `modulo simulate`, `modulo bench` and `modulo stability`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use modulo_runtime::sensor::parameters::BlurShape;

use super::words;

/// `modulo simulate`
#[derive(Args)]
pub struct Simulate {
    /// Pictures: PNG or JPEG of 8 or 16 bits, OpenEXR, Radiance HDR
    #[arg(required = true)]
    pub images: Vec<PathBuf>,
    /// Unwrapping methods
    #[arg(long, value_delimiter = ',', default_value = "auto")]
    pub method: Vec<String>,
    /// Saturation factors: brightest radiance over the sensor's peak
    #[arg(long, value_delimiter = ',', default_value = "4")]
    pub alpha: Vec<f64>,
    /// Linear radiance that maps to the peak, for EXR and HDR; 0: the brightest value of each file
    #[arg(long, default_value_t = 0.0)]
    pub white: f32,
    #[command(flatten)]
    pub sensor: Sensor,
    /// Folder for the pictures and results.json
    #[arg(short, long, value_name = "FOLDER")]
    pub out: PathBuf,
}

/// `modulo bench`
#[derive(Subcommand)]
pub enum Bench {
    /// Measure every method's time and accuracy, and chart one against the other
    Unwrap(BenchUnwrap),
    /// Draw the charts of a folder's results.json anew
    Chart {
        /// Folder with results.json and meta.json
        folder: PathBuf,
    },
}

/// `modulo bench unwrap`
#[derive(Args)]
pub struct BenchUnwrap {
    /// Folder of images; without it, the program's own scenes
    #[arg(long, value_name = "FOLDER")]
    pub frames: Option<PathBuf>,
    /// Unwrapping methods; all without any
    #[arg(long, value_delimiter = ',')]
    pub method: Vec<String>,
    /// Saturation factors: brightest radiance over the sensor's peak
    #[arg(long, value_delimiter = ',', default_value = "1.5,2,3,4,8")]
    pub alpha: Vec<f64>,
    /// Thread counts
    #[arg(long, value_delimiter = ',', default_value = "1")]
    pub threads: Vec<usize>,
    /// Timed calls for each frame
    #[arg(long, default_value_t = 5)]
    pub repeats: usize,
    #[command(flatten)]
    pub sensor: Sensor,
    /// Folder for results.json, meta.json and the charts
    #[arg(short, long, value_name = "FOLDER")]
    pub out: PathBuf,
}

/// The simulated sensor.
#[derive(Args)]
pub struct Sensor {
    /// Sigma of the lens blur in px; 0: a perfect lens
    #[arg(long, default_value_t = 1.4)]
    pub psf_sigma: f64,
    /// Blur of the lens: a Gaussian of --psf-sigma, or the paper's fixed 7 taps (about 1.4 px)
    #[arg(long, default_value = "gaussian", value_parser = words(BlurShape::WORDS))]
    pub psf: BlurShape,
    /// Bits of the sensor's converter
    #[arg(long, default_value_t = 8)]
    pub bits: u8,
    /// Sigma of the read noise in code units
    #[arg(long, default_value_t = 0.0)]
    pub read_noise: f64,
    /// Seed of the noise
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
}
