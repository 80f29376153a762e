//! Standard output and standard error: no other file writes to them.
//!
//! A line of the log that cannot be written is dropped, since neither a full disk nor a reader that has left may end the work. A result that
//! nobody reads any more, as behind `| head`, is dropped as well. A result that has no place, as on a full disk, is a [`failure`].

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{LazyLock, OnceLock};

use indicatif::ProgressBar;
use modulo_launch::supervisor::Channel;
use nix::poll::{PollFd, PollFlags, poll};

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
    log(&mut io::stderr(), &format!("{text}\n"));
}

/// Prints a line of a process, whose output is a log here, also what it has printed to standard output.
pub fn relay(channel: Channel, line: &str) {
    match channel {
        Channel::Out => log(&mut io::stdout(), &format!("{line}\n")),
        Channel::Err => note(format_args!("{line}")),
    }
}

/// Lines of the log that were dropped since the last one that was taken.
static DROPPED: AtomicU64 = AtomicU64::new(0);
/// How long a terminal or the reader of a pipe may take nothing, ms, before lines are dropped.
const PATIENCE_MS: u16 = 1000;
/// A pipe that is ready takes so many bytes without a wait.
const PIECE: usize = 4096;

/// Writes a line of the log. Neither an error nor a reader that stands still holds up the work.
fn log<T: AsFd + Write>(channel: &mut T, line: &str) {
    LINE.suspend(|| {
        let dropped = DROPPED.load(Ordering::Relaxed);
        if dropped > 0 && is_ready(channel, 0) {
            DROPPED.store(0, Ordering::Relaxed);
            let _ = writeln!(channel, "modulo: {dropped} lines found no reader");
        }
        for piece in line.as_bytes().chunks(PIECE) {
            // Where the line before found none, this one does not wait for a reader.
            let patience = if DROPPED.load(Ordering::Relaxed) > 0 { 0 } else { PATIENCE_MS };
            if !is_ready(channel, patience) {
                DROPPED.fetch_add(1, Ordering::Relaxed);
                return;
            }
            let _ = channel.write_all(piece);
        }
    });
}

/// Whether [`PIECE`] bytes can be written without a wait, after at most `patience` ms.
fn is_ready(channel: &impl AsFd, patience: u16) -> bool {
    let mut asked = [PollFd::new(channel.as_fd(), PollFlags::POLLOUT)];
    // Where it cannot be asked, the write has an error of its own.
    poll(&mut asked, patience).map_or(true, |ready| ready > 0)
}

/// Whether standard error takes a line now.
pub fn takes_log() -> bool {
    is_ready(&io::stderr(), 0)
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
        log(&mut io::stderr(), &String::from_utf8_lossy(text));
        Ok(text.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
