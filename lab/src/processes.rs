//! The processor time and the memory of a run.

use std::fs;
use std::io;
use std::process::{Child, ExitStatus};
use std::thread;
use std::time::Duration;

use nix::sys::resource::{UsageWho, getrusage};

/// Time between two looks at the memory of a run.
const GLANCE: Duration = Duration::from_millis(200);

/// Returns the processor time of all processes that this one has waited for, and of theirs, s.
pub fn children_cpu_s() -> nix::Result<f64> {
    let usage = getrusage(UsageWho::RUSAGE_CHILDREN)?;
    let seconds =
        [usage.user_time(), usage.system_time()].map(|t| t.tv_sec() as f64 + t.tv_usec() as f64 / 1e6);
    Ok(seconds.iter().sum())
}

/// Waits for the end of a run. Returns its status and the largest resident memory of its detector, MB, which may be all of the run.
pub fn watch(child: &mut Child, is_composed: bool) -> io::Result<(ExitStatus, f64)> {
    let (mut rss_mb, mut process) = (0.0, is_composed.then_some(child.id()));
    loop {
        // Found once, since each look at the processes takes time from them.
        process = process.or_else(|| detector_of(child.id()));
        // The largest value so far is kept by the system; a process that has just ended has none.
        rss_mb = process.and_then(peak_rss_mb).unwrap_or(rss_mb);
        if let Some(status) = child.try_wait()? {
            return Ok((status, rss_mb));
        }
        thread::sleep(GLANCE);
    }
}

/// Returns the process of the detector among the children of `launcher`.
fn detector_of(launcher: u32) -> Option<u32> {
    let tasks = fs::read_dir(format!("/proc/{launcher}/task")).ok()?.flatten();
    // A space follows each number.
    let children: String =
        tasks.filter_map(|task| fs::read_to_string(task.path().join("children")).ok()).collect();
    children.split_whitespace().filter_map(|pid| pid.parse().ok()).find(|pid| {
        let arguments = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        arguments.split(|&byte| byte == 0).nth(2) == Some(b"detector")
    })
}

fn peak_rss_mb(process: u32) -> Option<f64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok().map(|kb| kb / 1000.0)
}
