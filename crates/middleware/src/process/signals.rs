//! What ends a process from outside: signals, and the end of its launcher.

use std::io;
use std::os::unix::process::parent_id;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread;
use std::time::Duration;

use modulo_runtime::stop::is_hangup_ignored;
use modulo_runtime::{Stop, Urgency, launcher};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;
use signal_hook::iterator::Signals;

const GLANCE: Duration = Duration::from_millis(100);

/// Installs handlers: SIGINT asks `stop` for a drain; SIGTERM, SIGHUP or a second SIGINT for an end at once. A SIGHUP that
/// the process ignores since its start, as under `nohup`, stays ignored.
pub fn end_on_signals(stop: &Stop) -> io::Result<()> {
    let mut signals = Signals::new([SIGINT, SIGTERM])?;
    if !is_hangup_ignored() {
        signals.add_signal(SIGHUP)?;
    }
    let stop = stop.clone();
    thread::Builder::new().name("signals".into()).spawn(move || {
        for signal in signals.forever() {
            let urgency = match (signal, stop.urgency()) {
                (SIGINT, Urgency::None) => Urgency::Drain,
                _ => Urgency::Now,
            };
            stop.ask(urgency);
        }
    })?;
    Ok(())
}

/// Returns a flag that the first SIGINT or SIGTERM sets. The second one ends the process at once, as if there were no handler.
pub fn first_signal() -> io::Result<Arc<AtomicBool>> {
    let asked = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // Actions run in this order, so that the first signal finds the flag unset.
        flag::register_conditional_default(signal, asked.clone())?;
        flag::register(signal, asked.clone())?;
    }
    Ok(asked)
}

/// Asks `stop` for an end as soon as the launcher is gone, which cannot end its nodes then. Does nothing without one.
pub fn end_with_launcher(stop: &Stop) -> io::Result<()> {
    let launcher = std::env::var(launcher::PID).ok().and_then(|pid| pid.parse::<u32>().ok());
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
