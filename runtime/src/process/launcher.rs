//! The agreement between a launcher and its nodes: environment variables, files, and the end of a node without a
//! launcher.

use std::ffi::OsString;
use std::fs;
use std::io;
use std::os::unix::process::parent_id;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

use crate::process::stop::{Stop, Urgency};

/// The folder in which a node keeps its report.
pub const REPORT_DIR: &str = "MODULO_REPORT_DIR";
/// Folder in which a node keeps the state that must outlast a crash.
pub const STATE_DIR: &str = "MODULO_STATE_DIR";
/// Process id of the launcher.
pub const PID: &str = "MODULO_LAUNCHER_PID";

const GLANCE: Duration = Duration::from_millis(100);

/// Returns a folder that the launcher named, if there is one.
pub fn folder(variable: &str) -> Option<PathBuf> {
    std::env::var_os(variable).map(PathBuf::from)
}

/// Returns the file of the node with this fully qualified name in such a folder: `car.unwrap.json` for `/car/unwrap`
/// and the ending `json`.
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

/// Asks `stop` for an end as soon as the launcher is gone, since a launcher that was killed cannot end its nodes. Does
/// nothing without a launcher.
///
/// # Errors
/// The error of the operating system when it starts no thread.
pub fn end_with_launcher(stop: &Stop) -> io::Result<()> {
    let launcher = std::env::var(PID).ok().and_then(|pid| pid.parse::<u32>().ok());
    let Some(launcher) = launcher else { return Ok(()) };
    let stop = stop.clone();
    thread::Builder::new().name("launcher".into()).spawn(move || {
        // An orphan gets another parent.
        while parent_id() == launcher {
            thread::sleep(GLANCE);
        }
        tracing::warn!("the launcher {launcher} is gone, ending");
        stop.ask(Urgency::Now);
    })?;
    Ok(())
}
