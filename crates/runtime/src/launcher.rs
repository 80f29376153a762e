//! The agreement between a launcher and its nodes: environment variables and files.

use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The folder in which a node keeps its report.
pub const REPORT_DIR: &str = "MODULO_REPORT_DIR";
/// Folder in which a node keeps the state that must outlast a crash.
pub const STATE_DIR: &str = "MODULO_STATE_DIR";
/// Process id of the launcher.
pub const PID: &str = "MODULO_LAUNCHER_PID";

/// Returns a folder that the launcher named, if there is one.
pub fn folder(variable: &str) -> Option<PathBuf> {
    std::env::var_os(variable).map(PathBuf::from)
}

/// Returns the file of the node with this fully qualified name: `car.unwrap.json` for `/car/unwrap` and `json`.
pub fn file_of(folder: &Path, node: &str, ending: &str) -> PathBuf {
    folder.join(format!("{}.{ending}", node.trim_matches('/').replace('/', ".")))
}

/// Replaces the content of `file`. A reader finds either the old content or the new one, also after a crash of this
/// process. After a crash of the machine there is no guarantee.
///
/// # Errors
/// The error of the system; the old content is then unchanged.
pub fn replace(file: &Path, content: &[u8]) -> io::Result<()> {
    let mut beside: OsString = file.into();
    beside.push(".new");
    fs::write(&beside, content)?;
    // A rename replaces the file in one step, so that no reader finds half of it.
    fs::rename(&beside, file)
}
