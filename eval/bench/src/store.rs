//! JSON files that are whole at any time, also when the process is killed.

use std::fs;
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::StudyError;

/// Makes `folder` and those above it.
pub(crate) fn make_folder(folder: &Path) -> Result<(), StudyError> {
    fs::create_dir_all(folder).map_err(|source| StudyError::Io(folder.to_owned(), source))
}

/// Writes `value` beside `path` and moves it there.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), StudyError> {
    let mut text =
        serde_json::to_vec_pretty(value).map_err(|source| StudyError::Json(path.to_owned(), source))?;
    text.push(b'\n');
    write(path, &text)
}

/// Writes `bytes` beside `path` and moves them there.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<(), StudyError> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".part");
    fs::write(&beside, bytes)
        .and_then(|()| fs::rename(&beside, path))
        .map_err(|source| StudyError::Io(path.to_owned(), source))
}

/// Reads what [`write_json`] wrote.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, StudyError> {
    let text = fs::read(path).map_err(|source| StudyError::Io(path.to_owned(), source))?;
    serde_json::from_slice(&text).map_err(|source| StudyError::Json(path.to_owned(), source))
}
