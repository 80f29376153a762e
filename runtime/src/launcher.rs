//! What a launcher tells the nodes it starts, through their environment, and
//! the end of a node whose launcher has gone.

use std::io;
use std::os::unix::process::parent_id;
use std::path::PathBuf;
use std::thread;
use std::time::Duration;

use crate::stop::{Stop, Urgency};

/// The folder in which a node leaves its report.
pub const REPORT_DIR: &str = "MODULO_REPORT_DIR";
/// The folder in which a node keeps what must outlast its crash.
pub const STATE_DIR: &str = "MODULO_STATE_DIR";
/// Process id of the launcher.
pub const PID: &str = "MODULO_LAUNCHER_PID";

const GLANCE: Duration = Duration::from_millis(100);

/// A folder that the launcher named, if there is one.
pub fn folder(variable: &str) -> Option<PathBuf> {
    std::env::var_os(variable).map(PathBuf::from)
}

/// From now on `stop` is asked for when the launcher is gone: a launcher that
/// was killed cannot end its nodes itself. Without a launcher nothing is done.
///
/// # Errors
/// When the operating system gives no thread.
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
