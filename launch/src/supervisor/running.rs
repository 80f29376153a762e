//! [`Running`]: a started process that leads its own process group, which ends with it.

use std::io;
use std::path::PathBuf;
use std::process::{ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use nix::sys::signal::{Signal, killpg};
use nix::sys::wait::{Id, WaitPidFlag, WaitStatus, waitid};
use nix::unistd::Pid;
use tokio::io::{AsyncBufReadExt, AsyncRead, AsyncReadExt, BufReader};
use tokio::process::{Child, Command};
use tokio::signal::unix::{SignalKind, signal};
use tokio::task::JoinHandle;
use tokio::time::timeout;

use super::activity::{Activity, LONG_STEP};
use super::{Channel, Print, start_error};
use crate::LaunchError;
use crate::plan::ProcessPlan;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct CommandLine {
    pub program: PathBuf,
    pub arguments: Vec<String>,
}

/// A longer line is shown in pieces, so that memory stays bounded.
const LONGEST_LINE: u64 = 64 * 1024;
/// How long the last output is waited for after the group has been killed.
const LAST_WORDS: Duration = Duration::from_secs(1);

pub(super) struct Running {
    child: Child,
    /// `None` once the process was reaped: from then on the group's number may be that of another process.
    group: Option<Group>,
    readers: Vec<JoinHandle<()>>,
    print: Print,
    last_line: Arc<Mutex<String>>,
}

/// A process group; killed when let go.
struct Group(Pid);

impl Drop for Group {
    fn drop(&mut self) {
        let _ = killpg(self.0, Signal::SIGKILL);
    }
}

impl Running {
    /// Starts `command`; its output goes to `print`, each line marked.
    pub fn start(command: &CommandLine, process: &ProcessPlan, print: &Print) -> Result<Self, LaunchError> {
        let refuse =
            |why: String| start_error(&process.label, format!("{}: {why}", command.program.display()));
        let mut child = prepared(command, process).spawn().map_err(|e| refuse(e.to_string()))?;
        let id = child.id().and_then(|id| i32::try_from(id).ok());
        let group = Group(Pid::from_raw(id.ok_or_else(|| refuse("ended at once".to_owned()))?));
        let label = &process.label;
        let out = child.stdout.take().map(|out| forward(out, Channel::Out, label, print));
        let last_line = Arc::new(Mutex::new(String::new()));
        let (noted, shown) = (last_line.clone(), print.clone());
        let note: Print = Arc::new(move |channel, line: &str| {
            line.clone_into(&mut noted.lock().unwrap_or_else(PoisonError::into_inner));
            shown(channel, line);
        });
        let err = child.stderr.take().map(|err| forward(err, Channel::Err, label, &note));
        let readers = out.into_iter().chain(err).collect();
        Ok(Self { child, group: Some(group), readers, print: print.clone(), last_line })
    }

    /// Returns the number of the process; 0 once it was reaped.
    pub fn id(&self) -> i32 {
        self.group.as_ref().map_or(0, |Group(leader)| leader.as_raw())
    }

    /// Waits for the end of the process and kills what is left of its group.
    pub async fn wait(&mut self) -> io::Result<ExitStatus> {
        // Subscribed to before the first look, so that an end between look and wait is not missed.
        let mut children = signal(SignalKind::child())?;
        while let Some(Group(leader)) = &self.group {
            // It is not reaped here: until it is, no other process gets its number.
            let flags = WaitPidFlag::WEXITED | WaitPidFlag::WNOWAIT | WaitPidFlag::WNOHANG;
            if waitid(Id::Pid(*leader), flags)? == WaitStatus::StillAlive {
                children.recv().await;
            } else {
                // Letting the group go kills what the process has started and left running.
                self.group = None;
            }
        }
        self.child.wait().await
    }

    /// Asks the process to end with SIGINT, then with SIGTERM, and ends it with SIGKILL. While `is_patient`, a process that computes
    /// gets up to [`LONG_STEP`] times as long before the next signal: it works on its last frames. Where it took SIGKILL, also
    /// returns whether it computed then.
    pub async fn shut_down(
        &mut self,
        process: &ProcessPlan,
        is_patient: impl Fn() -> bool,
    ) -> (io::Result<ExitStatus>, Option<bool>) {
        // The order of ROS 2: SIGINT lets a node finish what is on its way, SIGTERM is for programs that
        // ignore it, and SIGKILL cannot be ignored.
        let steps = [
            (Signal::SIGINT, process.sigterm_timeout, Signal::SIGTERM),
            (Signal::SIGTERM, process.sigkill_timeout, Signal::SIGKILL),
        ];
        let mut computes = false;
        for (signal, patience, next) in steps {
            self.signal(signal);
            let (mut activity, mut waited) = (Activity::of(self.id()), Duration::ZERO);
            loop {
                if let Ok(status) = timeout(patience, self.wait()).await {
                    return (status, None);
                }
                waited += patience;
                computes = activity.was_busy(patience);
                if !is_patient() || !computes || waited >= patience * LONG_STEP {
                    break;
                }
            }
            let (label, seconds) = (&process.label, waited.as_secs_f64());
            let message = format!("[{label}] still runs {seconds} s after {signal}, sending {next}");
            (self.print)(Channel::Err, &message);
        }
        self.kill();
        (self.wait().await, Some(computes))
    }

    /// Kills the process and its group. Also a stopped process ends then.
    pub fn kill(&self) {
        self.signal(Signal::SIGKILL);
    }

    /// Sends `signal` to all processes of the group. A group that has ended already is no error.
    fn signal(&self, signal: Signal) {
        let _ = self.group.as_ref().map(|Group(leader)| killpg(*leader, signal));
    }

    /// Shows the last output. Returns the last line of standard error; empty where there is none.
    pub async fn finish(self) -> String {
        drop(self.group);
        // A process that has left the group may still hold the pipe open: the wait has a limit.
        for mut reader in self.readers {
            if timeout(LAST_WORDS, &mut reader).await.is_err() {
                reader.abort();
            }
        }
        let line = self.last_line.lock().unwrap_or_else(PoisonError::into_inner);
        line.split_once("] ").map_or(String::new(), |(_, line)| line.to_owned())
    }
}

fn prepared(command: &CommandLine, process: &ProcessPlan) -> Command {
    let mut prepared = Command::new(&command.program);
    // A process in the background that reads from the terminal would be stopped by SIGTTIN.
    prepared.args(&command.arguments).envs(&process.env).stdin(Stdio::null()).stderr(Stdio::piped());
    prepared.stdout(if process.errors_only { Stdio::null() } else { Stdio::piped() });
    // Its own group: Ctrl-C reaches the launcher alone, which then ends all in order.
    prepared.process_group(0).kill_on_drop(true);
    prepared
}

fn forward(
    stream: impl AsyncRead + Send + Unpin + 'static,
    channel: Channel,
    label: &str,
    print: &Print,
) -> JoinHandle<()> {
    let (print, label) = (print.clone(), label.to_owned());
    tokio::spawn(async move {
        let mut reader = BufReader::new(stream);
        let mut line = Vec::new();
        while let Ok(1..) = (&mut reader).take(LONGEST_LINE).read_until(b'\n', &mut line).await {
            // Any program may write any bytes: those that are not UTF-8 are replaced.
            let text = String::from_utf8_lossy(&line);
            print(channel, &format!("[{label}] {}", text.trim_end_matches(['\n', '\r'])));
            line.clear();
        }
    })
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    /// A process that is gone is not signalled: its number may be that of another one.
    #[tokio::test]
    async fn a_group_is_forgotten_with_its_leader_and_nothing_of_it_is_left() {
        let process = ProcessPlan {
            label: "parent".into(),
            env: [].into(),
            errors_only: false,
            respawn: None,
            ends_all: false,
            sigterm_timeout: Duration::ZERO,
            sigkill_timeout: Duration::ZERO,
        };
        let arguments = ["-c".to_owned(), "sleep 1000 & echo $!".to_owned()].into();
        let command = CommandLine { program: "/bin/sh".into(), arguments };
        let (sender, lines) = channel();
        let print: Print = Arc::new(move |_, line: &str| sender.send(line.to_owned()).expect("heard"));
        let mut running = Running::start(&command, &process, &print).expect("starts");
        assert!(running.wait().await.expect("ends").success());
        assert!(running.group.is_none());
        running.signal(Signal::SIGKILL);
        // It holds the pipe open: the output ends with it.
        running.finish().await;
        let child = lines.recv().expect("the child's number").replace("[parent] ", "");
        let state = || std::fs::read_to_string(format!("/proc/{child}/stat")).unwrap_or_default();
        let ended = || state().is_empty() || state().contains(") Z ");
        let start = std::time::Instant::now();
        while !ended() && start.elapsed() < Duration::from_secs(5) {
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        assert!(ended(), "{}", state());
    }
}
