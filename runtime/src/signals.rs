//! SIGINT and SIGTERM become a [`Stop`].

use std::io;
use std::thread;

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use crate::stop::{Stop, Urgency};

/// From now on SIGINT drains and SIGTERM, or a second SIGINT, ends at once.
///
/// # Errors
/// When the operating system refuses the handlers.
pub fn end_on_signals(stop: &Stop) -> io::Result<()> {
    let mut signals = Signals::new([SIGINT, SIGTERM])?;
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
