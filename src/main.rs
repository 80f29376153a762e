//! The command `modulo`: parse, dispatch, exit code. No logic.
//!
//! Exit codes: 0 done, 1 failed, 2 wrong command line, 3 done but something was
//! lost that should never be. No other place makes one.

mod cli;
mod command;

use std::process::ExitCode;

use anyhow::anyhow;
use command::terminal;
use modulo_middleware::process::memory::keep_freed_memory;
use modulo_runtime::secret::without_secrets;

/// Version of the suite.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Version, commit, target and inference engines of this binary.
pub const LONG_VERSION: &str = concat!(
    env!("CARGO_PKG_VERSION"),
    "\ncommit:  ",
    env!("MODULO_COMMIT"),
    "\ntarget:  ",
    env!("MODULO_TARGET"),
    "\nengines: rten (built in), ort (ONNX Runtime, loaded at run time where its library is found)"
);

/// How a command ended.
pub enum Ended {
    /// Done.
    Done,
    /// Done, but something was lost that should never be, such as a frame that could not be read or that a crash took.
    WithLoss,
}

impl Ended {
    /// How a command ended that has done its work, with something `lost` or without.
    pub fn of(lost: bool) -> Self {
        if lost { Self::WithLoss } else { Self::Done }
    }
}

/// Why a command did not do its work.
pub enum Failure {
    /// It was asked for something impossible.
    Usage(anyhow::Error),
    /// It failed.
    Run(anyhow::Error),
}

impl<E: Into<anyhow::Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Run(error.into())
    }
}

fn main() -> ExitCode {
    keep_freed_memory();
    let ended = match cli::parse() {
        Ok(Some(cli)) => command::dispatch(cli),
        Ok(None) => Ok(Ended::Done),
        Err(why) if why.use_stderr() => {
            // Where the reason cannot be printed, the code remains.
            let _ = why.print();
            return ExitCode::from(2);
        }
        Err(help) => {
            terminal::keep(help.print());
            Ok(Ended::Done)
        }
    };
    match (ended, terminal::failure()) {
        (Ok(_), Some(why)) => {
            fail(1, &anyhow!("standard output takes no more, and a part of the result is missing: {why}"))
        }
        (ended, _) => exit_code(ended),
    }
}

fn exit_code(ended: Result<Ended, Failure>) -> ExitCode {
    match ended {
        Ok(Ended::Done) => ExitCode::SUCCESS,
        Ok(Ended::WithLoss) => ExitCode::from(3),
        // A file that is not there is a wrong word of the command line, whichever part of the program has looked for it.
        Err(Failure::Run(why)) => fail(if is_missing_file(&why) { 2 } else { 1 }, &why),
        Err(Failure::Usage(why)) => fail(2, &why),
    }
}

fn is_missing_file(why: &anyhow::Error) -> bool {
    let mut causes = why.chain().filter_map(|cause| cause.downcast_ref::<std::io::Error>());
    causes.any(|cause| cause.kind() == std::io::ErrorKind::NotFound)
}

fn fail(code: u8, why: &anyhow::Error) -> ExitCode {
    terminal::note(format_args!(
        "{} {}",
        command::colour::error("modulo:"),
        without_secrets(&message_of(why))
    ));
    ExitCode::from(code)
}

/// Returns the error and its causes in one line. A cause that the text before it repeats already is left out.
fn message_of(why: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in why.chain().map(ToString::to_string) {
        if text.is_empty() {
            text = cause;
        // Many libraries write the text of their cause at the end of their own.
        } else if !text.ends_with(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use modulo_bags::bag::BagReader;

    use super::message_of;

    #[test]
    fn no_cause_is_told_twice() {
        let why = BagReader::open(std::path::Path::new("/no/such.mcap")).expect_err("is missing");
        let text = message_of(&anyhow::Error::new(why).context("bag"));
        assert!(text.starts_with("bag: ") && text.matches("os error").count() <= 1, "{text}");
        let plain = message_of(&anyhow::anyhow!("inner").context("outer"));
        assert_eq!(plain, "outer: inner");
    }
}
