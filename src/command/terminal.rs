//! Standard output and standard error: no other file writes to them.
//!
//! A line of the log that cannot be written is dropped, since neither a full disk nor a reader that has left may end the work. A result that
//! nobody reads any more, as behind `| head`, is dropped as well. A result that has no place, as on a full disk, is a [`failure`].

#![allow(clippy::disallowed_methods)]

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::sync::{LazyLock, Mutex, OnceLock, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use indicatif::ProgressBar;
use modulo_launch::supervisor::Channel;

/// The progress line of a run; hidden while nothing runs. Other lines are written above it.
pub static LINE: LazyLock<ProgressBar> = LazyLock::new(ProgressBar::hidden);
/// The first error of standard output that is a failure.
static FAILURE: OnceLock<io::Error> = OnceLock::new();

/// Prints a line of the result. Returns whether it was taken.
pub fn say(text: Arguments<'_>) -> bool {
    keep(LINE.suspend(|| writeln!(io::stdout().lock(), "{text}")))
}

/// Prints a line of the log.
pub fn note(text: Arguments<'_>) {
    // In one piece, so that the lines of several processes do not mix.
    let line = format!("{text}\n");
    let _ = LINE.suspend(|| io::stderr().write_all(line.as_bytes()));
}

/// Keeps the error of a result that could not be printed. Returns whether it was printed.
pub fn keep(printed: io::Result<()>) -> bool {
    let Err(why) = printed else { return true };
    if why.kind() != ErrorKind::BrokenPipe {
        let _ = FAILURE.set(why);
    }
    false
}

/// Returns why a part of the result has not been printed.
pub fn failure() -> Option<&'static io::Error> {
    keep(io::stdout().flush());
    FAILURE.get()
}

/// Standard error for the log, to which nothing is lost by an error: the writer of the log would panic.
pub struct LogWriter;

impl Write for LogWriter {
    fn write(&mut self, text: &[u8]) -> io::Result<usize> {
        let _ = LINE.suspend(|| io::stderr().write_all(text));
        Ok(text.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Lines of processes that wait for a terminal, or for the reader of a pipe.
const WAITING: usize = 1024;
/// How long a process is held up by a terminal that takes nothing, before its lines are dropped.
const PATIENCE: Duration = Duration::from_secs(1);
/// Time between two looks at whether there is room.
const GLANCE: Duration = Duration::from_millis(5);

/// Prints the lines of processes on a thread of its own: a terminal that takes nothing, such as a stopped one, holds up neither the
/// processes nor who supervises them.
pub struct Lines {
    /// `None` at the end.
    sender: Option<SyncSender<(Channel, String)>>,
    printer: Option<JoinHandle<()>>,
    /// Number of lines that were dropped since the last one that was taken.
    dropped: Mutex<u64>,
}

impl Lines {
    /// Starts the thread.
    pub fn start() -> Self {
        let (sender, lines) = sync_channel::<(Channel, String)>(WAITING);
        let printer = thread::spawn(move || lines.iter().for_each(|(channel, line)| print(channel, &line)));
        Self { sender: Some(sender), printer: Some(printer), dropped: Mutex::default() }
    }

    /// Prints a line above the progress line, after those before it.
    pub fn print(&self, channel: Channel, line: &str) {
        let mut dropped = self.dropped.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(sender) = &self.sender else { return };
        if *dropped > 0 && sender.try_send((Channel::Err, format!("[launch] {dropped} lines were dropped"))).is_ok() {
            *dropped = 0;
        }
        let (start, mut next) = (Instant::now(), (channel, line.to_owned()));
        // After a time without room, each line is tried once, until there is room again.
        let patience = if *dropped == 0 { PATIENCE } else { Duration::ZERO };
        while let Err(TrySendError::Full(back)) = sender.try_send(next) {
            if start.elapsed() >= patience {
                *dropped += 1;
                return;
            }
            next = back;
            thread::sleep(GLANCE);
        }
    }
}

impl Drop for Lines {
    /// Waits for the last lines, as long as somebody takes them.
    fn drop(&mut self) {
        drop(self.sender.take());
        let Some(printer) = self.printer.take() else { return };
        let start = Instant::now();
        while !printer.is_finished() && start.elapsed() < PATIENCE {
            thread::sleep(GLANCE);
        }
    }
}

/// The output of a process is a log here, also what it has printed to standard output.
fn print(channel: Channel, line: &str) {
    match channel {
        Channel::Out => drop(LINE.suspend(|| writeln!(io::stdout().lock(), "{line}"))),
        Channel::Err => note(format_args!("{line}")),
    }
}
