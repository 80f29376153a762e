//! The unwrapping methods on image files, with their times: on pictures through a simulated sensor, and on modulo images. The
//! stability suite.
//!
//! No crate of a node is used here: the methods are those of `modulo-core`, which the nodes use.

pub mod recover;
pub mod runner;
pub mod simulate;
pub mod stability;

use std::fs;
use std::path::{Path, PathBuf};

use modulo_core::{SensorError, UnwrapError, metric};
pub use modulo_draw::below_100;
use modulo_images::{EXTENSIONS, ImageError, SaveError, has_extension, is_hidden};
use modulo_runtime::ParameterError;
use modulo_runtime::output::{self, OutputError};
use modulo_video::VideoError;
use serde::Serialize;

/// Error of a simulation, benchmark or stability run. The message names the value and the possible ones.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// The request is impossible. The sentence names the possible values or the remedy.
    #[error("{0}")]
    Request(String),
    /// The folder takes no results.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A file cannot hold the codes of the sensor as they are. The text is the reason and the remedy.
    #[error("{path}: {1}", path = .0.display())]
    NotCodes(PathBuf, String),
    /// A file or folder cannot be read or written, or is not a list of results.
    #[error("{path}: {1}", path = .0.display())]
    Io(PathBuf, #[source] std::io::Error),
    /// An image cannot be read, or the white point is impossible.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A video cannot be read.
    #[error(transparent)]
    Video(#[from] VideoError),
    /// An image cannot be written.
    #[error(transparent)]
    Save(#[from] SaveError),
    /// A parameter of the sensor is impossible.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The sensor cannot be exposed to the image.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// The method does not exist, or refuses the image.
    #[error(transparent)]
    Unwrap(#[from] UnwrapError),
}

/// Name of the list of results in the folder of a command.
pub const RESULTS: &str = "results.json";

/// Returns the least of `values`, of which there is one, that the share `q` of them does not exceed.
pub fn quantile(values: impl IntoIterator<Item = f64>, q: f64) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    metric::quantile(&values, q).expect("there is a value")
}

/// Progress of a command.
#[derive(Clone, Debug, PartialEq)]
pub enum BenchEvent<'a> {
    /// `done` of `total` steps are finished; `next` describes the next one.
    Step {
        /// Number of finished steps.
        done: usize,
        /// Number of all steps.
        total: usize,
        /// Description, such as the file.
        next: &'a str,
    },
    /// Something was left out, such as a file that is skipped for a reason, which has its name.
    Warning(&'a str),
}

/// Returns `paths` with the image files of each folder among them in place of the folder, and tells what else is in it.
fn files(paths: &[PathBuf], tell: &mut dyn FnMut(BenchEvent<'_>)) -> Result<Vec<PathBuf>, BenchError> {
    if paths.is_empty() {
        let why = "the list of files is empty; at least one entry is needed";
        return Err(BenchError::Request(why.to_owned()));
    }
    let mut files = Vec::new();
    for path in paths {
        if path.is_dir() {
            files.extend(images(path, tell)?);
        } else {
            files.push(path.clone());
        }
    }
    Ok(files)
}

/// Returns the image files of `folder`, sorted by name, and tells how many other files are in it.
fn images(folder: &Path, tell: &mut dyn FnMut(BenchEvent<'_>)) -> Result<Vec<PathBuf>, BenchError> {
    let io = |source| BenchError::Io(folder.to_owned(), source);
    let (mut images, mut others) = (Vec::new(), Vec::new());
    for entry in fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        // Hidden files hold what systems note about others, such as `._x.png` of macOS.
        if path.is_dir() || is_hidden(&path) {
            continue;
        }
        if has_extension(&path, &EXTENSIONS) { &mut images } else { &mut others }.push(path);
    }
    if images.is_empty() {
        let (folder, kinds) = (folder.display(), EXTENSIONS.join(", "));
        return Err(BenchError::Request(format!("{folder}: there is no readable image ({kinds})")));
    }
    // The order of `read_dir` depends on the file system. The results must not.
    images.sort();
    if let Some(first) = others.iter().min() {
        let (folder, count, first) = (folder.display(), others.len(), first.display());
        tell(BenchEvent::Warning(&format!(
            "{folder}: skipped {count} files that are no images, the first: {first}"
        )));
    }
    Ok(images)
}

/// Writes `value` as JSON, as [`write`] does.
fn write_json(path: &Path, value: &impl Serialize) -> Result<(), BenchError> {
    let mut text =
        serde_json::to_vec_pretty(value).map_err(|why| BenchError::Io(path.to_owned(), why.into()))?;
    text.push(b'\n');
    write(path, &text)
}

/// Replaces the content of `path`, as [`output::replace`] does.
fn write(path: &Path, bytes: &[u8]) -> Result<(), BenchError> {
    output::replace(path, bytes).map_err(|why| BenchError::Io(path.to_owned(), why))
}
