//! Files of results that are whole at any time, also when the process is killed.

use std::path::Path;

use crate::grid::GridError;
use crate::results::{RESULTS, Results, TABLE};
use crate::table;

/// The results in `folder`; `None` when there are none.
///
/// # Errors
/// [`GridError`] when they cannot be read.
pub fn load(folder: &Path) -> Result<Option<Results>, GridError> {
    let path = folder.join(RESULTS);
    match std::fs::read(&path) {
        Ok(text) => {
            let json = |source| GridError::Json(path.clone(), source);
            serde_json::from_slice(&text).map(Some).map_err(json)
        }
        Err(why) if why.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(why) => Err(GridError::io(&path, why)),
    }
}

/// Writes [`RESULTS`] and [`TABLE`]; `folder` is made where it is missing.
///
/// # Errors
/// [`GridError`] when they cannot be written.
pub fn save(folder: &Path, results: &Results) -> Result<(), GridError> {
    std::fs::create_dir_all(folder).map_err(|why| GridError::io(folder, why))?;
    let path = folder.join(RESULTS);
    let mut text =
        serde_json::to_vec_pretty(results).map_err(|source| GridError::Json(path.clone(), source))?;
    text.push(b'\n');
    replace(&path, &text)?;
    replace(&folder.join(TABLE), &table::csv(&results.cells))
}

/// Writes beside `path` and moves it there.
pub(crate) fn replace(path: &Path, bytes: &[u8]) -> Result<(), GridError> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".part");
    std::fs::write(&beside, bytes)
        .and_then(|()| std::fs::rename(&beside, path))
        .map_err(|why| GridError::io(path, why))
}
