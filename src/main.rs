//! The command `modulo`: parse, dispatch, exit code. No logic.
//!
//! Exit codes: 0 done, 1 failed, 2 wrong command line, 3 done but something was
//! lost. Nowhere else is one made.

mod cli;
mod command;
mod registry;

use std::process::ExitCode;

/// How a command ended.
pub enum Ended {
    /// Done.
    Done,
    /// Done, but frames were dropped, skipped or missing.
    WithLoss,
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
    match command::dispatch(cli::parse()) {
        Ok(Ended::Done) => ExitCode::SUCCESS,
        Ok(Ended::WithLoss) => ExitCode::from(3),
        Err(Failure::Run(why)) => fail(1, &why),
        Err(Failure::Usage(why)) => fail(2, &why),
    }
}

fn fail(code: u8, why: &anyhow::Error) -> ExitCode {
    eprintln!("modulo: {why:#}");
    ExitCode::from(code)
}
