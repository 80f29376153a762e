//! [`Job`]: one process from its first start to its last end, restarts included.

use std::collections::VecDeque;
use std::fs::File;
use std::io;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use std::time::{Duration, Instant, SystemTime};

use modulo_runtime::launcher;
use modulo_runtime::trace::TRACE_DIR;
use nix::sys::signal::Signal;
use tempfile::TempDir;
use tokio::sync::watch;

use super::activity::{Activity, LONG_STEP};
use super::running::{CommandLine, Running};
use super::{Channel, Ending, Print, ProcessEnd, ProcessOutcome, Supervision, start_error};
use crate::LaunchError;
use crate::package::{SUITE, prefixes};
use crate::plan::{ExecutablePlan, NodePlan, Plan, ProcessPlan, ros_arguments};

/// A process that lived shorter crashed for a reason that may still be there.
const SHORT_LIFE: Duration = Duration::from_secs(5);
/// The pause before a restart doubles from this after each short life ...
const FIRST_PAUSE: Duration = Duration::from_millis(100);
/// ... up to this: a crashed node is back within 2 s.
const LONGEST_PAUSE: Duration = Duration::from_secs(1);
/// Time over which restarts are limited.
const MINUTE: Duration = Duration::from_secs(60);
/// Time between two looks at the report of a node.
const LOOK: Duration = Duration::from_millis(250);

/// The origin of the program of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Origin {
    /// A node of this suite: its exit statuses are known, and it ends cleanly on SIGINT.
    Suite,
    /// A command of this suite, such as a player: its exit statuses 2 and 3 are known.
    Command,
    /// Any other program.
    Foreign,
}

pub(super) struct Job {
    pub origin: Origin,
    pub command: CommandLine,
    pub process: ProcessPlan,
    /// The signs of life of a node that is replaced when it hangs.
    pub life_signs: Option<LifeSigns>,
    /// The largest number of restarts within a minute; `None` sets no limit.
    pub max_restarts: Option<u32>,
}

/// Where a node of the suite shows that its loop still runs: it writes its report at least once a second.
#[derive(Clone, Debug)]
pub(super) struct LifeSigns {
    folder: PathBuf,
    /// Fully qualified name of the node.
    node: String,
    /// The node hangs when its report is older than this, and it has not computed meanwhile.
    limit: Duration,
}

/// The folders for the files of the nodes. They last as long as the run, so that a node that is started again finds its state.
pub(super) struct Folders {
    reports: RunFolder,
    state: RunFolder,
    traces: RunFolder,
}

/// A folder that is removed with its launcher, or by a later one.
struct RunFolder {
    folder: TempDir,
    /// Locked as long as the launcher lives. `None` where no file can be locked: nobody else then removes the folder.
    _owner: Option<File>,
}

impl RunFolder {
    /// Makes a folder in `parent`, from which it removes the folders of launchers that were killed.
    fn new_in(parent: &Path) -> io::Result<Self> {
        remove_leftovers(parent);
        let folder = tempfile::Builder::new().prefix(PREFIX).tempdir_in(parent)?;
        // The file gets its name when it is locked, so that no other launcher finds it unlocked.
        let (new, named) = (folder.path().join("owner.new"), folder.path().join(OWNER));
        let owner = File::create(&new).and_then(|file| {
            file.try_lock()?;
            std::fs::rename(&new, &named)?;
            Ok(file)
        });
        Ok(Self { folder, _owner: owner.ok() })
    }
}

/// Removes the folders in `parent` whose launcher is dead: nobody locks their file any more.
fn remove_leftovers(parent: &Path) {
    for entry in std::fs::read_dir(parent).into_iter().flatten().flatten() {
        let (name, owner) = (entry.file_name(), entry.path().join(OWNER));
        let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
        // A pipe of another user would be waited for.
        let is_file = std::fs::symlink_metadata(&owner).is_ok_and(|found| found.is_file());
        if !(name.as_encoded_bytes().starts_with(PREFIX.as_bytes()) && is_folder && is_file) {
            continue;
        }
        if File::open(&owner).is_ok_and(|file| file.try_lock().is_ok()) {
            // Fails only where the folder is another user's, or is being removed by another launcher.
            let _ = std::fs::remove_dir_all(entry.path());
        }
    }
}

/// The names of the folders begin with this.
const PREFIX: &str = "modulo_launch_";
/// The file in a folder that its launcher keeps locked.
const OWNER: &str = "owner.lock";

impl Folders {
    /// Makes the folders. A node writes its report before it sends a result, so that the reports lie in memory where that is
    /// possible: a file on a disk costs half a millisecond of each result.
    pub fn new() -> io::Result<Self> {
        let on_disk = || RunFolder::new_in(&std::env::temp_dir());
        let in_memory = || RunFolder::new_in(Path::new(MEMORY)).or_else(|_| on_disk());
        Ok(Self { reports: in_memory()?, state: in_memory()?, traces: on_disk()? })
    }

    pub fn reports(&self) -> &Path {
        self.reports.folder.path()
    }

    pub fn traces(&self) -> &Path {
        self.traces.folder.path()
    }
}

/// A folder in memory, which Linux has.
const MEMORY: &str = "/dev/shm";

/// Returns the jobs of `plan`, whose nodes write into `folders`.
pub(super) fn all(plan: &Plan, how: &Supervision, folders: &Folders) -> Result<Vec<Job>, LaunchError> {
    let reports = folders.reports();
    let traced = how.trace.iter().map(|_| (TRACE_DIR, folders.traces().display().to_string()));
    let variables = [
        (launcher::REPORT_DIR, reports.display().to_string()),
        (launcher::STATE_DIR, folders.state.folder.path().display().to_string()),
        (launcher::PID, std::process::id().to_string()),
    ];
    let variables: Vec<_> = variables.into_iter().chain(traced).collect();
    let nodes = plan.nodes.iter().map(|node| node_job(node, how, reports, &variables));
    let executables = plan.executables.iter().map(|executable| Ok(executable_job(executable, how, reports)));
    nodes.chain(executables).collect()
}

/// Returns the job of a node that gets `variables`. A node of the suite is run by it, another one from its package.
fn node_job(
    node: &NodePlan,
    how: &Supervision,
    reports: &Path,
    variables: &[(&str, String)],
) -> Result<Job, LaunchError> {
    let origin = if node.package == SUITE { Origin::Suite } else { Origin::Foreign };
    let mut process = node.process.clone();
    // These come after the variables of the plan: no launch file can lead the reports of a node elsewhere.
    process.env.extend(variables.iter().map(|(name, value)| ((*name).to_owned(), value.clone())));
    let watched = origin == Origin::Suite && process.respawn.is_some();
    let life_signs = how.hang_timeout.filter(|_| watched).and_then(|limit| {
        Some(LifeSigns { folder: reports.to_owned(), node: node.fully_qualified()?, limit })
    });
    let (mut program, mut arguments) = (how.suite.clone(), ros_arguments(node));
    if origin == Origin::Suite {
        arguments.splice(0..0, ["run".to_owned(), node.executable.clone()]);
    } else {
        program = installed(node)?;
    }
    let command = CommandLine { program, arguments };
    Ok(Job { origin, command, process, life_signs, max_restarts: how.max_restarts })
}

/// Returns the job of an `executable` action. The suite's own command is run by it, whether or not it is on the PATH.
fn executable_job(executable: &ExecutablePlan, how: &Supervision, reports: &Path) -> Job {
    let (mut process, command) = (executable.process.clone(), executable.command.split_first());
    let (word, arguments) = command.expect("the plan of an executable has a command that is not empty");
    let (mut origin, mut program) = (Origin::Foreign, PathBuf::from(word));
    if word == SUITE {
        (origin, program) = (Origin::Command, how.suite.clone());
        // A player of the suite reports what it has sent.
        process.env.insert(launcher::REPORT_DIR.to_owned(), reports.display().to_string());
    }
    let command = CommandLine { program, arguments: arguments.to_vec() };
    Job { origin, command, process, life_signs: None, max_restarts: how.max_restarts }
}

fn installed(node: &NodePlan) -> Result<PathBuf, LaunchError> {
    let place = |prefix: PathBuf| prefix.join("lib").join(&node.package).join(&node.executable);
    let places: Vec<PathBuf> = prefixes().into_iter().map(place).collect();
    if let Some(program) = places.iter().find(|place| place.is_file()) {
        return Ok(program.clone());
    }
    let package = &node.package;
    Err(start_error(
        &node.process.label,
        if places.is_empty() {
            format!("package '{package}' is not found: AMENT_PREFIX_PATH is empty, is ROS 2 sourced?")
        } else {
            let places: Vec<String> = places.iter().map(|place| place.display().to_string()).collect();
            format!("executable is not found, looked at {}", places.join(", "))
        },
    ))
}

impl Job {
    /// Runs the process until it has ended for good. `end_signal` has the reason when all are to end.
    pub async fn keep(self, mut end_signal: watch::Receiver<Option<Ending>>, print: Print) -> ProcessOutcome {
        let mut restarts = Restarts::default();
        let end = loop {
            let start = Instant::now();
            let running = match Running::start(&self.command, &self.process, &print) {
                Ok(running) => running,
                Err(error) => {
                    self.say(&print, &error.to_string());
                    break ProcessEnd::NotStarted(error.to_string());
                }
            };
            let (life, last_line) = self.live(running, &mut end_signal, restarts.count, &print).await;
            match life.and_then(|end| self.after_end(end, &last_line, start.elapsed(), &mut restarts, &print))
            {
                Ok((delay, _)) if pause(delay, &mut end_signal).await => {}
                Ok((_, end)) | Err(end) => break end,
            }
        };
        ProcessOutcome { label: self.process.label.clone(), restarts: restarts.count, end }
    }

    /// Returns how a life ended, and the last line of standard error. `Err` is the end of a process that was told to end.
    async fn live(
        &self,
        mut running: Running,
        end_signal: &mut watch::Receiver<Option<Ending>>,
        restarts: u32,
        print: &Print,
    ) -> (Result<ProcessEnd, ProcessEnd>, String) {
        let id = running.id();
        // A process that ends at the same moment is not called shut down: this branch comes first.
        let life = tokio::select! {
            biased;
            status = running.wait() => Ok(status.map_err(|why| why.to_string())),
            why = hang(self.life_signs.as_ref(), id) => {
                self.say(print, &format!("{why}; it is killed"));
                running.kill();
                // What it returns says only that it was killed.
                let _ = running.wait().await;
                Ok(Err(why))
            }
            () = end_requested(end_signal) => {
                // The user who interrupts a run does not want to wait for the step at hand.
                let is_patient = || self.origin == Origin::Suite && *end_signal.borrow() == Some(Ending::Completed);
                Err(running.shut_down(&self.process, is_patient).await)
            }
        };
        // The last lines of this life are shown before the first ones of the next.
        let last_line = running.finish().await;
        let end = match life {
            Ok(status) => Ok(self.ended(status, restarts, &last_line)),
            Err((status, killed)) => Err(after_shutdown(self.origin, &status, killed, &last_line)),
        };
        (end, last_line)
    }

    /// Returns the pause before the next start after a life of `lived` with this end; or how the process ended for good.
    fn after_end(
        &self,
        end: ProcessEnd,
        last_line: &str,
        lived: Duration,
        restarts: &mut Restarts,
        print: &Print,
    ) -> Result<(Duration, ProcessEnd), ProcessEnd> {
        let ProcessEnd::Crashed(status) = &end else { return Err(end) };
        let Some(delay) = self.process.respawn else {
            self.say(print, &format!("ended with {status}"));
            return Err(end);
        };
        let now = Instant::now();
        if let Some(crashes) = restarts.exceed(self.max_restarts, now) {
            self.say(print, &format!("ended with {status}, crash {crashes} within a minute: the run ends"));
            let reason = if last_line.is_empty() { String::new() } else { format!(" ({last_line})") };
            return Err(ProcessEnd::GaveUp(crashes, format!("{status}{reason}")));
        }
        let delay = delay.max(restarts.next(lived, now));
        let (count, ms) = (restarts.count, delay.as_millis());
        self.say(print, &format!("ended with {status}, restart {count} in {ms} ms"));
        Ok((delay, end))
    }

    /// A program of the suite that refuses its arguments at its first start will always do so. At a restart it has accepted them
    /// before: what has changed, such as a file that is not there, may change again.
    fn ended(&self, status: Result<ExitStatus, String>, restarts: u32, last_line: &str) -> ProcessEnd {
        match status {
            Ok(status) if status.success() => ProcessEnd::Exited,
            Ok(status) if is_with_loss(self.origin, &status) => ProcessEnd::WithLoss(last_line.to_owned()),
            Ok(status) if status.code() == Some(2) && self.origin != Origin::Foreign && restarts == 0 => {
                ProcessEnd::Refused(last_line.strip_prefix("modulo: ").unwrap_or(last_line).to_owned())
            }
            Ok(status) => ProcessEnd::Crashed(status.to_string()),
            Err(why) => ProcessEnd::Crashed(why),
        }
    }

    fn say(&self, print: &Print, message: &str) {
        print(Channel::Err, &format!("[{}] {message}", self.process.label));
    }
}

/// Returns whether a program of this suite has done its work, but has lost something.
fn is_with_loss(origin: Origin, status: &ExitStatus) -> bool {
    origin != Origin::Foreign && status.code() == Some(3)
}

/// Programs differ in their status after SIGINT. Nodes of the suite end with 0, but for one that has just been started and
/// does not catch the signals yet: it has done nothing that could be lost.
///
/// A node that was `killed` was slow, and has not crashed: it has lost what it was working on.
fn after_shutdown(
    origin: Origin,
    status: &io::Result<ExitStatus>,
    killed: Option<bool>,
    last_line: &str,
) -> ProcessEnd {
    let asked = [Signal::SIGINT as i32, Signal::SIGTERM as i32];
    match (origin, status) {
        (Origin::Suite, Ok(status))
            if status.signal() == Some(Signal::SIGKILL as i32) && killed.is_some() =>
        {
            ProcessEnd::Killed { computed: killed == Some(true) }
        }
        (_, Ok(status)) if is_with_loss(origin, status) => ProcessEnd::WithLoss(last_line.to_owned()),
        (Origin::Suite, Ok(status))
            if !status.success() && !status.signal().is_some_and(|s| asked.contains(&s)) =>
        {
            ProcessEnd::Crashed(status.to_string())
        }
        _ => ProcessEnd::ShutDown,
    }
}

#[derive(Default)]
struct Restarts {
    /// Since the launch.
    count: u32,
    /// Crashes after short lives, one after the other.
    short_lives: u32,
    /// When the restarts of the last minute were.
    recent: VecDeque<Instant>,
}

impl Restarts {
    /// Returns the number of crashes within the last minute if a restart at `now` would be one more than `most` allows.
    fn exceed(&mut self, most: Option<u32>, now: Instant) -> Option<u32> {
        self.recent.retain(|time| now.duration_since(*time) < MINUTE);
        let recent = u32::try_from(self.recent.len()).unwrap_or(u32::MAX);
        most.filter(|most| recent >= *most).map(|_| recent.saturating_add(1))
    }

    /// Counts a restart at `now`, after a life of `lived`; returns the pause before it.
    fn next(&mut self, lived: Duration, now: Instant) -> Duration {
        self.count += 1;
        self.recent.push_back(now);
        // After a long run the back-off is reset: the next restart is immediate.
        self.short_lives = if lived < SHORT_LIFE { self.short_lives + 1 } else { 0 };
        backoff(self.short_lives)
    }
}

/// Returns the pause after a number of short lives: none after the first one, then twice the last one.
fn backoff(short_lives: u32) -> Duration {
    match short_lives {
        0 | 1 => Duration::ZERO,
        // The exponent has a limit, since a number of 32 bits cannot be shifted any further.
        n => FIRST_PAUSE.saturating_mul(1 << (n - 2).min(8)).min(LONGEST_PAUSE),
    }
}

/// Waits until the node of the process `id` hangs, and returns what is wrong. Ends never for a process without signs of life.
///
/// A node that loads its model or waits for others has not written its report a second time, and is not judged. The looks are
/// counted and not the time: a launcher that stood still itself must not blame its nodes.
async fn hang(life_signs: Option<&LifeSigns>, id: i32) -> String {
    let Some(LifeSigns { folder, node, limit }) = life_signs else { return std::future::pending().await };
    let looks = limit.as_millis().div_ceil(LOOK.as_millis()).max(1);
    let (mut seen, mut changes, mut unchanged, mut activity) = (None, 0, 0, Activity::of(id));
    loop {
        tokio::time::sleep(LOOK).await;
        let now = last_report(folder, node);
        if now != seen {
            // The first one that is seen is that of an earlier life, or the one that the process makes at its start.
            changes += u32::from(now.is_some());
            (seen, unchanged, activity) = (now, 0, Activity::of(id));
            continue;
        }
        unchanged += 1;
        if changes <= 1 || unchanged % looks != 0 {
            continue;
        }
        let limits = unchanged / looks;
        if !activity.was_busy(*limit) || limits >= LONG_STEP.into() {
            return format!("no sign of life for {} s", limit.as_secs_f64() * limits as f64);
        }
    }
}

/// Returns the number of lives that have a report, and when the last one was written.
fn last_report(folder: &Path, node: &str) -> Option<(u32, SystemTime)> {
    let written = |life: u32| -> Option<SystemTime> {
        let report = launcher::file_of(folder, node, &format!("{life}.json")).metadata().ok()?;
        // An empty file is one that a node is just making.
        report.modified().ok().filter(|_| report.len() > 0)
    };
    (1..).map_while(|life| Some((life, written(life)?))).last()
}

/// Waits until all are told to end. It also returns when the supervisor, which tells it, has ended.
async fn end_requested(end_signal: &mut watch::Receiver<Option<Ending>>) {
    let _ = end_signal.wait_for(Option::is_some).await;
}

/// Waits for `delay`. Returns false when all are told to end before it is over.
async fn pause(delay: Duration, end_signal: &mut watch::Receiver<Option<Ending>>) -> bool {
    tokio::select! {
        biased;
        // The order to end wins over a start that is due at the same moment.
        () = end_requested(end_signal) => false,
        () = tokio::time::sleep(delay) => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One node had refused its arguments, and the run said that another one had crashed: SIGINT had ended it while it started.
    #[test]
    fn a_node_that_is_ended_while_it_starts_has_not_crashed() {
        let after = |origin, wait_status, killed| {
            after_shutdown(origin, &Ok(ExitStatus::from_raw(wait_status)), killed, "why")
        };
        let end = |origin, wait_status| after(origin, wait_status, None);
        for signal in [Signal::SIGINT, Signal::SIGTERM] {
            assert_eq!(end(Origin::Suite, signal as i32), ProcessEnd::ShutDown);
        }
        let exit_code_1 = 1 << 8;
        for status in [Signal::SIGKILL as i32, Signal::SIGSEGV as i32, exit_code_1] {
            assert!(matches!(end(Origin::Suite, status), ProcessEnd::Crashed(_)), "{status}");
        }
        let sigkill = Signal::SIGKILL as i32;
        for computed in [true, false] {
            let end = after(Origin::Suite, sigkill, Some(computed));
            assert_eq!((&end, end.is_failure()), (&ProcessEnd::Killed { computed }, false));
        }
        assert_eq!(after(Origin::Foreign, sigkill, Some(true)), ProcessEnd::ShutDown);
        assert_eq!(end(Origin::Foreign, exit_code_1), ProcessEnd::ShutDown);
        let exit_code_3 = 3 << 8;
        assert_eq!(end(Origin::Foreign, exit_code_3), ProcessEnd::ShutDown);
        assert_eq!(end(Origin::Command, exit_code_3), ProcessEnd::WithLoss("why".into()));
    }

    #[test]
    fn a_crashed_process_is_back_within_two_seconds() {
        assert_eq!(backoff(1), Duration::ZERO);
        assert_eq!(backoff(2), FIRST_PAUSE);
        assert!((0..100).map(backoff).all(|pause| pause <= LONGEST_PAUSE));
        assert_eq!(backoff(u32::MAX), LONGEST_PAUSE);
    }

    #[test]
    fn folders_of_dead_launchers_are_removed_and_others_stay() {
        let parent = tempfile::tempdir().expect("a folder");
        let made = |name: &str, owner: Option<&str>| {
            let folder = parent.path().join(name);
            std::fs::create_dir(&folder).expect("a folder");
            owner.map(|owner| File::create(folder.join(owner)).expect("a file"));
            folder
        };
        let dead = made("modulo_launch_dead", Some(OWNER));
        let other = made("another_dead", Some(OWNER));
        let beginning = made("modulo_launch_begins", None);
        let alive = RunFolder::new_in(parent.path()).expect("a folder");
        let next = RunFolder::new_in(parent.path()).expect("a folder");
        assert!(!dead.exists());
        assert!(other.exists() && beginning.exists() && alive.folder.path().exists());
        drop(alive);
        assert!(next.folder.path().exists());
        assert_eq!(std::fs::read_dir(parent.path()).expect("there").count(), 3);
    }

    #[test]
    fn restarts_are_limited_within_a_minute_and_not_over_a_long_run() {
        let (begin, mut restarts) = (Instant::now(), Restarts::default());
        for second in [0, 7, 14, 21] {
            let now = begin + Duration::from_secs(second);
            assert_eq!(restarts.exceed(Some(3), now), (second == 21).then_some(4));
            restarts.next(Duration::ZERO, now);
        }
        let late = begin + Duration::from_secs(21) + MINUTE;
        assert_eq!((restarts.exceed(Some(3), late), restarts.count), (None, 4));
        assert_eq!(restarts.exceed(Some(0), late), Some(1), "no restart is allowed");
        assert_eq!(restarts.exceed(None, late), None);
    }
}
