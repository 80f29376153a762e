//! The agreement between a launcher and its nodes: environment variables and files.

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
