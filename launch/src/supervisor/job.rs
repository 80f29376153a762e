//! [`Job`]: one process from its first start to its last end, restarts included.

use std::path::Path;
use std::process::ExitStatus;
use std::time::{Duration, Instant};

use modulo_runtime::launcher;
use tokio::sync::watch;

use super::command::{self, CommandLine};
use super::running::Running;
use super::{Channel, Print, ProcessEnd, ProcessOutcome, Supervision};
use crate::error::LaunchError;
use crate::plan::{Plan, ProcessPlan, Respawn};
use crate::substitution::SUITE;

/// A process that lived shorter crashed for a reason that may still be there.
const SHORT_LIFE: Duration = Duration::from_secs(5);
/// The pause before a restart doubles from this after each short life ...
const FIRST_PAUSE: Duration = Duration::from_millis(100);
/// ... up to this: a crashed node is back within 2 s.
const LONGEST_PAUSE: Duration = Duration::from_secs(1);

/// Whose program a process is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Origin {
    /// A node of this suite: its exit statuses are known, and it ends cleanly on SIGINT.
    Suite,
    /// Any other program.
    Foreign,
}

/// One process to keep running.
pub(super) struct Job {
    pub origin: Origin,
    pub command: CommandLine,
    pub process: ProcessPlan,
}

/// The jobs of `plan`. Nodes leave their reports in `reports`, and in `state`
/// what outlasts their crash.
pub(super) fn all(
    plan: &Plan,
    how: &Supervision,
    reports: &Path,
    state: &Path,
) -> Result<Vec<Job>, LaunchError> {
    let told = [
        (launcher::REPORT_DIR, reports.display().to_string()),
        (launcher::STATE_DIR, state.display().to_string()),
        (launcher::PID, std::process::id().to_string()),
    ];
    let nodes = plan.nodes.iter().map(|node| {
        let origin = if node.package == SUITE { Origin::Suite } else { Origin::Foreign };
        let mut process = node.process.clone();
        process.env.extend(told.iter().map(|(name, value)| ((*name).to_owned(), Some(value.clone()))));
        Ok(Job { origin, command: command::of_node(node, &how.suite)?, process })
    });
    let executables = plan.executables.iter().map(|executable| {
        let command = command::of_executable(executable, &how.suite);
        Ok(Job { origin: Origin::Foreign, command, process: executable.process.clone() })
    });
    nodes.chain(executables).collect()
}

impl Job {
    /// Runs the process until it has ended for good. `told` turns true when all
    /// are to end.
    pub async fn keep(self, mut told: watch::Receiver<bool>, print: Print) -> ProcessOutcome {
        let (mut restarts, mut short_lives) = (0, 0);
        let done = |restarts, end| ProcessOutcome { label: self.process.label.clone(), restarts, end };
        if !pause(self.process.start_after, &mut told).await {
            return done(0, ProcessEnd::ShutDown);
        }
        loop {
            let start = Instant::now();
            let mut running = match Running::start(&self.command, &self.process, &print) {
                Ok(running) => running,
                Err(error) => {
                    self.say(&print, &error.to_string());
                    return done(restarts, ProcessEnd::NotStarted(error.to_string()));
                }
            };
            let end = tokio::select! {
                biased;
                status = running.wait() => self.ended(status, restarts),
                () = told_to_end(&mut told) => {
                    let status = running.shut_down(&self.process).await;
                    running.finish().await;
                    return done(restarts, self.after_shutdown(&status));
                }
            };
            running.finish().await;
            let ProcessEnd::Crashed(status) = &end else {
                return done(restarts, end);
            };
            short_lives = if start.elapsed() < SHORT_LIFE { short_lives + 1 } else { 0 };
            let Some(delay) = self.restart_delay(restarts, short_lives) else {
                self.say(&print, &format!("ended with {status}"));
                return done(restarts, end);
            };
            restarts += 1;
            self.say(&print, &format!("ended with {status}, restart {restarts} in {} ms", delay.as_millis()));
            if !pause(delay, &mut told).await {
                return done(restarts, end);
            }
        }
    }

    /// A node that refuses its arguments at its first start will always do so. At a restart it has accepted them
    /// before: what has changed, such as a file that is not there, may change again.
    fn ended(&self, status: std::io::Result<ExitStatus>, restarts: u32) -> ProcessEnd {
        match status {
            Ok(status) if status.success() => ProcessEnd::Exited,
            Ok(status) if status.code() == Some(2) && self.origin == Origin::Suite && restarts == 0 => {
                ProcessEnd::Refused
            }
            Ok(status) => ProcessEnd::Crashed(status.to_string()),
            Err(error) => ProcessEnd::Crashed(error.to_string()),
        }
    }

    /// Programs differ in their status after SIGINT; nodes of the suite end with 0.
    fn after_shutdown(&self, status: &std::io::Result<ExitStatus>) -> ProcessEnd {
        match (self.origin, status) {
            (Origin::Suite, Ok(status)) if !status.success() => ProcessEnd::Crashed(status.to_string()),
            _ => ProcessEnd::ShutDown,
        }
    }

    /// The pause before the next start; `None` when there is none.
    fn restart_delay(&self, restarts: u32, short_lives: u32) -> Option<Duration> {
        match self.process.respawn {
            Respawn::After { delay, max_retries } if max_retries.is_none_or(|most| restarts < most) => {
                Some(delay.max(backoff(short_lives)))
            }
            _ => None,
        }
    }

    fn say(&self, print: &Print, message: &str) {
        print(Channel::Err, &format!("[{}] {message}", self.process.label));
    }
}

/// Nothing after the first short life, then doubling.
fn backoff(short_lives: u32) -> Duration {
    match short_lives {
        0 | 1 => Duration::ZERO,
        n => FIRST_PAUSE.saturating_mul(1 << (n - 2).min(8)).min(LONGEST_PAUSE),
    }
}

/// Waits until all are told to end, or nobody is left who could tell.
async fn told_to_end(told: &mut watch::Receiver<bool>) {
    let _ = told.wait_for(|told| *told).await;
}

/// Waits; false when all are told to end before it is over.
async fn pause(delay: Duration, told: &mut watch::Receiver<bool>) -> bool {
    tokio::select! {
        biased;
        () = told_to_end(told) => false,
        () = tokio::time::sleep(delay) => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crashed_process_is_back_within_two_seconds() {
        assert_eq!(backoff(1), Duration::ZERO);
        assert_eq!(backoff(2), FIRST_PAUSE);
        assert!((0..100).map(backoff).all(|pause| pause <= LONGEST_PAUSE));
        assert_eq!(backoff(u32::MAX), LONGEST_PAUSE);
    }
}
