//! Reads the file of the known defects of a sensor.

use std::fs;
use std::io::{self, Read as _};
use std::path::Path;

use modulo_core::unwrap::DefectMap;
use modulo_runtime::ParameterError;

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
    let text = read_text(Path::new(path)).map_err(|error| refuse(error.to_string()))?;
    text.parse().map_err(|why: modulo_core::unwrap::DefectMapError| refuse(why.to_string()))
}

/// Reads a regular file of at most [`MOST`] bytes. A pipe or a device could keep its reader for ever.
fn read_text(path: &Path) -> io::Result<String> {
    if !fs::metadata(path)?.is_file() {
        return Err(io::Error::other("is not a regular file; give the path of a CSV file with lines x,y"));
    }
    let mut text = String::new();
    fs::File::open(path)?.take(MOST + 1).read_to_string(&mut text)?;
    if text.len() as u64 > MOST {
        return Err(io::Error::other(format!("is larger than {MOST} bytes, and no map of defects")));
    }
    Ok(text)
}
