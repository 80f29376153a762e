//! `simulate`: one's own pictures through the sensor and the methods.
//!
//! Every file is a scene of its own. Nothing of one file, not even the white
//! found in it, is used for another.

mod picture;

use std::collections::HashSet;
use std::path::PathBuf;

use modulo_core::unwrap::{Options, by_name};
use modulo_core::{Psf, Sensor, SensorConfig, Unwrap};
use modulo_images::White;

use serde::{Deserialize, Serialize};

use crate::store::{make_folder, write_json};
use crate::{Event, Skipped, StudyError, need};

/// Name of the list of results in the folder.
pub const RESULTS: &str = "results.json";

/// What to simulate.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Pictures: PNG or JPEG of 8 or 16 bits, OpenEXR, Radiance HDR.
    pub files: Vec<PathBuf>,
    /// Folder for pictures and results; made when it is not there.
    pub out: PathBuf,
    /// Saturation factors, each in (0, 256].
    pub alphas: Vec<f64>,
    /// Names of methods, as in [`modulo_core::unwrap::METHODS`].
    pub methods: Vec<String>,
    /// Blur of the lens; see [`Psf::of_sigma`].
    pub psf: Psf,
    /// b, 1 to 16.
    pub bits: u8,
    /// Sigma of the read noise, code units.
    pub read_noise: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Linear radiance that maps to the peak, for EXR and HDR; 0: the brightest value of each file.
    pub white: f32,
}

impl Default for Request {
    /// No files; alpha 4, `auto`, a perfect lens, 8 bits, no noise.
    fn default() -> Self {
        Self {
            files: Vec::new(),
            out: PathBuf::new(),
            alphas: vec![4.0],
            methods: vec!["auto".to_owned()],
            psf: Psf::None,
            bits: 8,
            read_noise: 0.0,
            seed: 0,
            white: 0.0,
        }
    }
}

/// How a method did on a picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The picture, as it was given.
    pub file: String,
    /// Saturation factor.
    pub alpha: f64,
    /// Blur of the lens, px.
    pub psf_sigma: f64,
    /// As in [`modulo_core::unwrap::METHODS`].
    pub method: String,
    /// `10 log10(255^2 / mse)` of the recovered 8-bit picture against the ideal one, over all samples;
    /// `None` (`null`) where they are equal and the ratio is infinite.
    pub psnr_db: Option<f64>,
    /// Mean SSIM of these two pictures, as [`modulo_core::metric::ssim`]; `None` below 11 px a side.
    pub ssim: Option<f64>,
    /// Share of the samples whose wrap count is the true one, 0 to 1.
    pub exact_k: f64,
    /// What did it: the method's own name, or the rung that it chose.
    pub rung: String,
    /// Whether the method vouches for its result; `None`: it makes no claim.
    pub trusted: Option<bool>,
    /// One call, ms on one thread; `bench unwrap` is for timing.
    pub ms: f64,
}

/// What came of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// File by file, alpha by alpha, method by method; also in [`RESULTS`].
    pub rows: Vec<Row>,
    /// Files that could not be read or sensed.
    pub skipped: Vec<Skipped>,
}

/// Writes for each file and alpha `NAME_alphaA_ideal.png`, `.._saturated.png`, `.._modulo.png`, for each
/// method `NAME_alphaA_METHOD.png`, and after each file [`RESULTS`] with all rows so far.
///
/// `ideal` and the recovered pictures are 8 bits, `round(255 x / (alpha 2^b))`; `modulo` and `saturated`
/// hold the sensor's codes as they are, 8 bits a sample for b <= 8, else 16.
///
/// # Errors
/// [`StudyError`] before anything is written when the request is wrong, and when a result cannot be written.
/// A file that cannot be used is skipped, unless it is the only one.
pub fn simulate(request: &Request, tell: &mut dyn FnMut(Event<'_>)) -> Result<Outcome, StudyError> {
    let (sensors, mut methods) = (sensors(request)?, methods(request)?);
    make_folder(&request.out)?;
    let names = names(&request.files);
    let total = request.files.len() * sensors.len();
    let mut outcome = Outcome::default();
    for (index, (file, name)) in request.files.iter().zip(&names).enumerate() {
        let picture = picture::Picture { file, name, request };
        let rows = picture.read().and_then(|radiance| {
            let mut rows = Vec::new();
            for (sensor, done) in sensors.iter().zip(index * sensors.len()..) {
                let next = format!("{} alpha {}", file.display(), sensor.range().alpha());
                tell(Event::Step { done, total, next: &next });
                rows.extend(picture.sense(&radiance, sensor, &mut methods)?);
            }
            Ok(rows)
        });
        match rows {
            Ok(rows) => outcome.rows.extend(rows),
            Err(why @ (StudyError::Image(_) | StudyError::Sensor(_))) if request.files.len() > 1 => {
                let skipped = Skipped { file: file.display().to_string(), why: why.to_string() };
                tell(Event::Skipped(&skipped));
                outcome.skipped.push(skipped);
            }
            Err(why) => return Err(why),
        }
        write_json(&request.out.join(RESULTS), &outcome.rows)?;
    }
    Ok(outcome)
}

/// A sensor for each alpha.
fn sensors(request: &Request) -> Result<Vec<Sensor>, StudyError> {
    need("the list of files", &request.files)?;
    White::new(request.white)?;
    let Request { bits, psf, read_noise, .. } = *request;
    crate::sensors(&request.alphas, SensorConfig { bits, alpha: 1.0, psf, read_noise, shot_noise: 0.0 })
}

fn methods(request: &Request) -> Result<Vec<Box<dyn Unwrap>>, StudyError> {
    need("the list of methods", &request.methods)?;
    let method = |name: &String| Ok(by_name(name, &Options::default())?);
    request.methods.iter().map(method).collect()
}

/// The stem of each file, with `-2`, `-3` and so on where another file has it already.
fn names(files: &[PathBuf]) -> Vec<String> {
    let mut taken = HashSet::new();
    let free = |file: &PathBuf| {
        let stem = file.file_stem().unwrap_or(file.as_os_str()).to_string_lossy().into_owned();
        let numbered = (2..).map(|n: u32| format!("{stem}-{n}"));
        let mut names = std::iter::once(stem.clone()).chain(numbered);
        names.find(|name| taken.insert(name.clone())).unwrap_or(stem)
    };
    files.iter().map(free).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_stems_are_told_apart() {
        let files = ["a/x.png", "b/x.png", "x-2.jpg", "x.exr", "y"].map(PathBuf::from);
        assert_eq!(names(&files), ["x", "x-2", "x-2-2", "x-3", "y"]);
    }
}
