//! Reads the file of the known defects of a sensor.

use std::path::Path;

use modulo_core::unwrap::DefectMap;
use modulo_runtime::ParameterError;
use modulo_runtime::input::read_text;

/// The largest file in bytes.
const MOST: u64 = 1 << 20;

/// Reads the map at `path`; an empty path is an empty map.
///
/// # Errors
/// [`ParameterError`] of `defects`: the file is no regular file of at most 1 MiB, or has another form.
pub(crate) fn read(path: &str) -> Result<DefectMap, ParameterError> {
    if path.is_empty() {
        return Ok(DefectMap::default());
    }
    let refuse = |why: String| ParameterError::new("defects", path, why);
    let text = read_text(Path::new(path), MOST).map_err(|error| refuse(error.to_string()))?;
    text.parse().map_err(|why: modulo_core::unwrap::DefectMapError| refuse(why.to_string()))
}
