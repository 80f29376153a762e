//! Runs a [`Plan`]: starts its processes, marks their output, starts crashed ones again, and ends them all in order. No
//! process outlives the launcher: each leads its own process group, which is killed when it is let go.
//!
//! At a shutdown every process gets SIGINT, after its `sigterm_timeout` SIGTERM, after its `sigkill_timeout` SIGKILL.

mod activity;
mod job;
mod running;

use std::convert::Infallible;
use std::fmt;
use std::future::Future;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use modulo_runtime::launcher;
use modulo_runtime::stop::is_hangup_ignored;
use nix::sys::signal::kill;
use nix::unistd::Pid;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::watch;
use tokio::task::JoinSet;

use crate::LaunchError;
use crate::plan::Plan;
use crate::summary::{NodeReport, Summary, reports_in, reports_so_far};
use crate::trace::{self, TraceCounts};

use job::{Folders, Job};

/// The surroundings in which a plan is run.
#[derive(Clone)]
pub struct Supervision {
    /// The program that runs this suite's nodes as `<suite> run <node>`.
    pub suite: PathBuf,
    /// Takes every line that is to be shown.
    pub print: Print,
    /// Takes the reports of the nodes several times a second while they run.
    pub watch: Option<Watch>,
    /// A node of the suite with `respawn` that shows no sign of life for so long is killed and started again; `None`
    /// lets it hang. A longer step is no hang while it computes, up to 20 times this time.
    pub hang_timeout: Option<Duration>,
    /// A process that crashes more often than this within a minute ends the run; `None` sets no limit.
    pub max_restarts: Option<u32>,
    /// File for a trace of the run: the spans of all nodes of the suite as trace events of Chrome and Perfetto.
    pub trace: Option<PathBuf>,
}

/// Restarts within a minute that are allowed by default. The first crash is answered at once and the pauses grow up to a
/// second, so that a process that crashes at each start reaches this within some seconds.
pub const MAX_RESTARTS: u32 = 10;

/// Takes a line to be shown.
pub type Print = Arc<dyn Fn(Channel, &str) + Send + Sync>;

/// Takes the reports of the nodes.
pub type Watch = Arc<dyn Fn(&[NodeReport]) + Send + Sync>;

/// Time between two looks at the reports.
const GLANCE: Duration = Duration::from_millis(200);

/// Where a line is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// Standard output.
    Out,
    /// Standard error.
    Err,
}

impl Supervision {
    /// Creates the surroundings with the running program as the suite and [`MAX_RESTARTS`]. No node is killed for hanging.
    ///
    /// # Errors
    /// [`LaunchError::Other`] when the running program's path is unknown.
    pub fn new(print: Print, watch: Option<Watch>) -> Result<Self, LaunchError> {
        let suite = std::env::current_exe().map_err(|e| start_error("launcher", e))?;
        Ok(Self { suite, print, watch, hang_timeout: None, max_restarts: Some(MAX_RESTARTS), trace: None })
    }
}

/// How a run went.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Why it ended.
    pub ending: Ending,
    /// Every process, in the order of their ends.
    pub processes: Vec<ProcessOutcome>,
    /// What the nodes of this suite reported.
    pub reports: Vec<NodeReport>,
    /// The content of the trace, if one was asked for, or why it could not be written.
    pub trace: Option<Result<TraceCounts, LaunchError>>,
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// All processes have ended, or one whose end is the end of all.
    Completed,
    /// The launcher was told to end.
    Interrupted,
}

/// How one process went.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProcessOutcome {
    /// Its label.
    pub label: String,
    /// How often it was started again.
    pub restarts: u32,
    /// How it ended.
    pub end: ProcessEnd,
}

/// How a process ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ProcessEnd {
    /// By itself, with exit status 0.
    Exited,
    /// By itself, a command of this suite that has lost something (exit status 3). With the last line of its standard error.
    WithLoss(String),
    /// Because it was told to.
    ShutDown,
    /// A node of this suite that was told to end, did not in time, and was ended by SIGKILL.
    Killed {
        /// Whether it was working when it was killed, as on a slow frame.
        computed: bool,
    },
    /// By itself, otherwise; with the status in words.
    Crashed(String),
    /// By itself, more often within a minute than restarts are allowed: the crashes within the last minute, and the status of the
    /// last one in words, with the last line of its standard error.
    GaveUp(u32, String),
    /// A node or a command of this suite that refused its command line at its first start (exit status 2), as it always would. With the
    /// last line of its standard error.
    Refused(String),
    /// It could not be started.
    NotStarted(String),
}

impl fmt::Display for ProcessEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Exited => write!(f, "ended"),
            Self::WithLoss(why) => write!(f, "ended with a loss: {why}"),
            Self::ShutDown => write!(f, "was shut down"),
            Self::Killed { computed: true } => write!(f, "was ended by SIGKILL while it computed"),
            Self::Killed { computed: false } => {
                write!(f, "did not end when it was told to, and was ended by SIGKILL")
            }
            Self::Crashed(status) => write!(f, "crashed: {status}"),
            Self::GaveUp(crashes, status) => write!(
                f,
                "crashed {crashes} times within a minute, the last time with {status}; remove the cause, or allow more \
                 restarts with --max-restarts"
            ),
            Self::Refused(why) => write!(f, "refused its arguments: {why}"),
            Self::NotStarted(why) => write!(f, "could not be started: {why}"),
        }
    }
}

impl ProcessEnd {
    /// Whether something went wrong.
    pub fn is_failure(&self) -> bool {
        matches!(self, Self::Crashed(_)) || self.is_final()
    }

    /// Whether the process is missing for good, so that the others have nothing to wait for.
    fn is_final(&self) -> bool {
        matches!(self, Self::GaveUp(..) | Self::Refused(_) | Self::NotStarted(_))
    }
}

impl Outcome {
    /// The nodes' reports added up.
    pub fn summary(&self) -> Summary {
        let has_lost = |end: &ProcessEnd| matches!(end, ProcessEnd::WithLoss(_) | ProcessEnd::Killed { .. });
        let with_loss = self.processes.iter().filter(|p| has_lost(&p.end));
        Summary {
            with_loss: with_loss.map(|p| format!("{} {}", p.label, p.end)).collect(),
            ..Summary::new(&self.reports, self.processes.iter().map(|p| (p.label.as_str(), p.restarts)))
        }
    }
}

pub(crate) fn start_error(process: &str, why: impl ToString) -> LaunchError {
    LaunchError::Other(format!("{process}: {}", why.to_string()))
}

fn open(kind: SignalKind) -> Result<Signal, LaunchError> {
    signal(kind).map_err(|e| start_error("launcher", e))
}

/// Runs `plan` until all its processes have ended, one of them ends all, or the launcher gets SIGINT, SIGTERM or SIGHUP.
///
/// # Errors
/// [`LaunchError::Other`] when an executable is not found; nothing has been started then.
pub async fn run(plan: Plan, how: &Supervision) -> Result<Outcome, LaunchError> {
    // The handlers come first: a signal would else end the launcher and leave processes running.
    let (mut interrupt, mut terminate) = (open(SignalKind::interrupt())?, open(SignalKind::terminate())?);
    // Under nohup, a closed terminal does not end the run.
    let mut hangup = (!is_hangup_ignored()).then(|| open(SignalKind::hangup())).transpose()?;
    let stop = async {
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
            Some(_) = async { hangup.as_mut()?.recv().await } => {}
            () = orphaned() => {}
        }
    };
    run_until(plan, how, stop).await
}

/// Ends when the program of the suite that has started this launcher for itself is gone, which cannot end it then.
async fn orphaned() {
    let starter = std::env::var(launcher::PID).ok().and_then(|pid| pid.parse().ok());
    let Some(starter) = starter.map(Pid::from_raw) else { return std::future::pending().await };
    while kill(starter, None).is_ok() {
        tokio::time::sleep(GLANCE).await;
    }
}

/// Runs `plan` as [`run`] does, until `stop` completes in place of the signals.
///
/// # Errors
/// As [`run`].
pub async fn run_until(
    plan: Plan,
    how: &Supervision,
    stop: impl Future<Output = ()>,
) -> Result<Outcome, LaunchError> {
    // A process inherits the signals that its launcher ignores, as under nohup, but not those that it handles: an ignored
    // SIGINT could end no process that does not handle it.
    let _handled = [open(SignalKind::interrupt())?, open(SignalKind::terminate())?];
    let folders = Folders::new().map_err(|e| start_error("launcher", format!("temporary folder: {e}")))?;
    let jobs = job::all(&plan, how, &folders)?;
    // The second future never ends: it only passes reports on until the processes are done.
    let (ending, processes) = tokio::select! {
        ended = supervise(jobs, how, stop) => ended,
        never = watch_reports(how.watch.as_ref(), folders.reports()) => match never {},
    };
    let trace = how.trace.as_ref().map(|file| trace::join(folders.traces(), file));
    let warn = |file: &Path, why| tracing::warn!("report {} is left out: {why}", file.display());
    Ok(Outcome { ending, processes, reports: reports_in(folders.reports(), warn), trace })
}

/// Passes the reports in `folder` on to `watch`, again and again.
async fn watch_reports(watch: Option<&Watch>, folder: &Path) -> Infallible {
    let Some(watch) = watch else { return std::future::pending().await };
    loop {
        watch(&reports_so_far(folder));
        tokio::time::sleep(GLANCE).await;
    }
}

async fn supervise(
    jobs: Vec<Job>,
    how: &Supervision,
    stop: impl Future<Output = ()>,
) -> (Ending, Vec<ProcessOutcome>) {
    // The order to end is a state and not an event: a process between two starts finds it later.
    let (shut_down, end_signal) = watch::channel(None);
    let mut running = JoinSet::new();
    for job in jobs {
        let (print, end_signal) = (how.print.clone(), end_signal.clone());
        running.spawn(async move { (job.process.ends_all, job.keep(end_signal, print).await) });
    }
    let (mut ending, mut ended) = (Ending::Completed, Vec::new());
    tokio::pin!(stop);
    loop {
        tokio::select! {
            // A future that has completed must not be polled again.
            () = &mut stop, if ending == Ending::Completed => {
                ending = Ending::Interrupted;
                shut_down.send_replace(Some(ending));
            }
            end = running.join_next() => match end {
                None => return (ending, ended),
                Some(Ok((ends_all, outcome))) => {
                    let last = outcome.end.is_final();
                    ended.push(outcome);
                    if last || ends_all {
                        shut_down.send_replace(Some(ending));
                    }
                }
                // A task that panicked has let its process go, and with it killed it.
                Some(Err(_)) => {
                    shut_down.send_replace(Some(ending));
                }
            }
        }
    }
}
