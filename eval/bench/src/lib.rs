//! The benchmarks of the whole pipeline and of the inference engines, which run the program as a user does.

pub mod engines;
pub mod pipeline;

use std::fs;
use std::path::{Path, PathBuf};

use modulo_core::metric;
pub use modulo_draw::below_100;
use modulo_runtime::output::{self, OutputError};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Error of a benchmark. The message names the value and the possible ones.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// The request is impossible. The sentence names the possible values or the remedy.
    #[error("{0}")]
    Request(String),
    /// The folder takes no results.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A file or folder cannot be read or written, or is not a list of results.
    #[error("{path}: {1}", path = .0.display())]
    Io(PathBuf, #[source] std::io::Error),
    /// A run of the pipeline, or of the network by itself, fails.
    #[error("{0}")]
    Run(String),
}

/// Name of the list of results in the folder of a command.
pub const RESULTS: &str = "results.json";

/// Returns the least of `values`, of which there is one, that the share `q` of them does not exceed.
pub fn quantile(values: impl IntoIterator<Item = f64>, q: f64) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    metric::quantile(&values, q).expect("there is a value")
}

impl BenchError {
    fn number(what: &str, value: usize, possible: &str) -> Self {
        Self::Request(format!("{what} is {value}, but must be {possible}"))
    }
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

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, BenchError> {
    let text = fs::read(path).map_err(|source| BenchError::Io(path.to_owned(), source))?;
    serde_json::from_slice(&text).map_err(|why| BenchError::Io(path.to_owned(), why.into()))
}
