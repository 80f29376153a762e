//! Writes files that are complete at any time, even if the process is killed.

use std::fs;
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::BenchError;

/// Creates `folder` and its parents.
pub(crate) fn make_folder(folder: &Path) -> Result<(), BenchError> {
    fs::create_dir_all(folder).map_err(|source| BenchError::Io(folder.to_owned(), source))
}

/// Writes `value` as JSON to a temporary file beside `path` and renames it.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), BenchError> {
    let mut text =
        serde_json::to_vec_pretty(value).map_err(|source| BenchError::Json(path.to_owned(), source))?;
    text.push(b'\n');
    write(path, &text)
}

/// Writes `bytes` to a temporary file beside `path` and renames it.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<(), BenchError> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".part");
    fs::write(&beside, bytes)
        .and_then(|()| fs::rename(&beside, path))
        .map_err(|source| BenchError::Io(path.to_owned(), source))
}

/// Reads a JSON file.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, BenchError> {
    let text = fs::read(path).map_err(|source| BenchError::Io(path.to_owned(), source))?;
    serde_json::from_slice(&text).map_err(|source| BenchError::Json(path.to_owned(), source))
}
