//! The processes of a plan end in order, are started again after a crash, and none is left running.

use std::future::pending;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use modulo_launch::supervisor::{ProcessEnd, run_until};
use modulo_launch::{Ending, LaunchError, Outcome, Supervision, run};
use nix::sys::signal::{Signal, raise};

use crate::Files;

/// Whether a process failed in the end. A crash that a restart has repaired is no failure.
fn failed(outcome: &Outcome) -> bool {
    outcome.processes.iter().any(|process| process.end.is_failure())
}

/// The lines that a run shows.
#[derive(Clone, Default)]
struct Lines(Arc<Mutex<Vec<String>>>);

impl Lines {
    fn supervision(&self, suite: &str) -> Supervision {
        let lines = self.0.clone();
        let print = Arc::new(move |_, line: &str| lines.lock().expect("not poisoned").push(line.to_owned()));
        Supervision {
            suite: PathBuf::from(suite),
            print,
            watch: None,
            hang_timeout: None,
            max_restarts: Some(3),
            trace: None,
        }
    }

    fn all(&self) -> Vec<String> {
        self.0.lock().expect("not poisoned").clone()
    }

    async fn wait_for(&self, line: &str) {
        while !self.all().iter().any(|l| l == line) {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }
}

/// An `executable` action that runs `script`; a dollar is the shell's.
fn sh(name: &str, script: &str, more: &str) -> String {
    let script = script.replace('$', "\\$");
    format!("  - executable:\n      name: {name}\n      cmd: /bin/sh -c \"{script}\"\n{more}")
}

const LAST: &str = "      on_exit: shutdown\n";
const IMPATIENT: &str = "      sigterm_timeout: 0.2\n      sigkill_timeout: 0.2\n";
const RESPAWN: &str = "      respawn: 'true'\n";

async fn outcome(actions: &[String], lines: &Lines) -> Result<Outcome, LaunchError> {
    let plan = Files::new(&format!("launch:\n{}", actions.concat())).resolve(&[]).expect("resolves");
    run_until(plan, &lines.supervision("/nonexistent"), pending()).await
}

fn end<'a>(outcome: &'a Outcome, label: &str) -> &'a ProcessEnd {
    &outcome.processes.iter().find(|process| process.label == label).expect("ran").end
}

/// A zombie that nobody has reaped yet is not alive.
fn is_alive(pid: &str) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat.rsplit(") ").next().is_some_and(|rest| !rest.is_empty() && !rest.starts_with('Z'))
}

/// Waits until the process is gone: the kernel may take a moment to end the last process of a group.
async fn wait_for_end(pid: &str) {
    for _ in 0..6000 {
        if !is_alive(pid) {
            return;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    panic!("process {pid} is still there after a minute");
}

/// Files by which one script tells another how far it is.
struct Marks(tempfile::TempDir);

impl Marks {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    /// The command that sets a mark.
    fn set(&self, name: &str) -> String {
        format!("touch {}", self.0.path().join(name).display())
    }

    /// The commands that wait for all marks.
    fn wait(&self, names: &[&str]) -> String {
        let wait =
            |name| format!("while [ ! -e {} ]; do sleep 0.05; done", self.0.path().join(name).display());
        names.iter().copied().map(wait).collect::<Vec<_>>().join("; ")
    }
}

#[tokio::test]
async fn lines_are_marked_and_all_ends_are_awaited() {
    let lines = Lines::default();
    let actions = [sh("a", "echo one; echo two >&2", ""), sh("b", "sleep 0.2; printf three", "")];
    let outcome = outcome(&actions, &lines).await.expect("runs");
    let mut shown = lines.all();
    shown.sort();
    assert_eq!(shown, ["[a] one", "[a] two", "[b] three"]);
    assert!(!failed(&outcome));
    assert_eq!(outcome.ending, Ending::Completed);
}

#[tokio::test]
async fn on_exit_shutdown_ends_the_others_with_everything_they_started() {
    let lines = Lines::default();
    let ready = Marks::new();
    let script = format!("echo $$; sleep 1000 & echo $!; {}; wait", ready.set("other"));
    let last = sh("last", &ready.wait(&["other"]), LAST);
    let outcome = outcome(&[sh("other", &script, ""), last], &lines).await.expect("runs");
    assert!(!lines.all().iter().any(|line| line.contains("SIGTERM")), "both shells end at SIGINT");
    assert_eq!(end(&outcome, "other"), &ProcessEnd::ShutDown);
    assert!(!failed(&outcome));
    let pids: Vec<String> =
        lines.all().iter().filter_map(|l| l.strip_prefix("[other] ")).map(String::from).collect();
    assert_eq!(pids.len(), 2);
    for pid in &pids {
        wait_for_end(pid).await;
    }
}

#[tokio::test]
async fn a_process_that_does_not_listen_is_ended_ever_more_firmly() {
    let lines = Lines::default();
    let ready = Marks::new();
    let deaf = |name: &str, signals: &str| {
        let set = ready.set(name);
        sh(name, &format!("trap '' {signals}; {set}; while true; do sleep 0.05; done"), IMPATIENT)
    };
    let last = sh("last", &ready.wait(&["no_int", "no_term"]), LAST);
    let actions = [deaf("no_int", "INT"), deaf("no_term", "INT TERM"), last];
    let outcome = outcome(&actions, &lines).await.expect("runs");
    assert_eq!(outcome.processes.len(), 3);
    assert!(!failed(&outcome));
    let shown = lines.all();
    let message =
        |label: &str, signal: &str| shown.iter().any(|l| l.starts_with(label) && l.ends_with(signal));
    assert!(message("[no_int]", "sending SIGTERM") && !message("[no_int]", "sending SIGKILL"), "{shown:?}");
    assert!(message("[no_term]", "sending SIGKILL"), "{shown:?}");
}

#[tokio::test]
async fn a_crash_fails_the_run_and_the_others_go_on() {
    let lines = Lines::default();
    let actions =
        [sh("bad", "exit 7", ""), sh("killed", "kill -9 $$", ""), sh("good", "sleep 0.3; echo done", "")];
    let outcome = outcome(&actions, &lines).await.expect("runs");
    assert!(failed(&outcome));
    assert_eq!(end(&outcome, "good"), &ProcessEnd::Exited);
    assert!(matches!(end(&outcome, "bad"), ProcessEnd::Crashed(status) if status.contains('7')));
    assert!(matches!(end(&outcome, "killed"), ProcessEnd::Crashed(status) if status.contains("SIGKILL")));
    assert!(lines.all().contains(&"[good] done".to_owned()));
}

#[tokio::test]
async fn a_crashed_process_is_restarted_and_counted() {
    let lines = Lines::default();
    let folder = tempfile::tempdir().expect("a folder");
    let mark = folder.path().join("mark");
    // The file tells the second life from the first one.
    let script = format!("if [ -e {0} ]; then echo back; else touch {0}; exit 1; fi", mark.display());
    let outcome = outcome(&[sh("phoenix", &script, RESPAWN)], &lines).await.expect("runs");
    assert!(!failed(&outcome));
    assert_eq!(outcome.processes[0].restarts, 1);
    assert_eq!(outcome.summary().restarts["phoenix"], 1);
    assert!(lines.all().contains(&"[phoenix] back".to_owned()));
}

/// A node that crashes at each start ended no run, and the others waited for it for ever.
#[tokio::test]
async fn too_many_restarts_end_all_with_the_reason() {
    let actions = [sh("sick", "echo no lens >&2; exit 5", RESPAWN), sh("other", "sleep 1000", "")];
    let outcome = outcome(&actions, &Lines::default()).await.expect("runs");
    assert_eq!(end(&outcome, "other"), &ProcessEnd::ShutDown);
    let sick = end(&outcome, "sick").to_string();
    assert!(failed(&outcome) && sick.contains("crashed 4 times within a minute"), "{sick}");
    assert!(sick.contains("exit status: 5 (no lens)") && sick.contains("--max-restarts"), "{sick}");
}

#[tokio::test]
async fn a_program_that_does_not_exist_ends_all() {
    let missing = "  - executable: { cmd: /nonexistent/program }\n".to_owned();
    let outcome = outcome(&[missing, sh("other", "sleep 1000", "")], &Lines::default()).await.expect("runs");
    assert!(failed(&outcome));
    assert!(
        matches!(end(&outcome, "program"), ProcessEnd::NotStarted(why) if why.contains("/nonexistent/program"))
    );
    assert_eq!(end(&outcome, "other"), &ProcessEnd::ShutDown);
}

#[tokio::test]
async fn a_missing_package_is_found_out_before_anything_starts() {
    let lines = Lines::default();
    let node = "  - node: { pkg: nowhere, exec: e }\n".to_owned();
    let error = outcome(&[sh("other", "echo started", ""), node], &lines).await.expect_err("refused");
    assert_eq!(
        error.to_string(),
        "e: package 'nowhere' is not found: AMENT_PREFIX_PATH is empty, is ROS 2 sourced?"
    );
    assert!(lines.all().is_empty());
}

/// A suite whose nodes are scripts: `<suite> run <node> --ros-args ...`.
fn suite(files: &Files, script: &str) -> String {
    use std::os::unix::fs::PermissionsExt;
    let path = files.path("suite");
    std::fs::write(&path, format!("#!/bin/sh\n{script}\n")).expect("written");
    std::fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).expect("executable");
    path.display().to_string()
}

#[tokio::test]
async fn nodes_of_the_suite_are_run_by_it_and_report() {
    let files =
        Files::new("launch:\n  - node: { pkg: modulo, exec: unwrap, param: [{ name: bits, value: 8 }] }\n");
    let script = r#"echo "$@"
echo '{"node": "/unwrap", "published": {"/recovered": 5}}' > "$MODULO_REPORT_DIR/unwrap.1.json"
echo '{"node": "/unwrap", "published": {"/recovered": 2}}' > "$MODULO_REPORT_DIR/unwrap.2.json""#;
    let lines = Lines::default();
    let how = lines.supervision(&suite(&files, script));
    let outcome = run_until(files.resolve(&[]).expect("resolves"), &how, pending()).await.expect("runs");
    assert_eq!(lines.all(), ["[unwrap] run unwrap --ros-args -r __node:=unwrap -r __ns:=/ -p bits:=8"]);
    assert_eq!(outcome.summary().topics["/recovered"].sent, 7, "both lives are added up");
}

#[tokio::test]
async fn a_refused_command_line_is_not_tried_again() {
    let files = Files::new(&format!(
        "launch:\n  - node: {{ pkg: modulo, exec: unwrap, respawn: 'true' }}\n{}",
        sh("other", "sleep 1000", "")
    ));
    let how = Lines::default().supervision(&suite(&files, "echo modulo: why >&2; exit 2"));
    let outcome = run_until(files.resolve(&[]).expect("resolves"), &how, pending()).await.expect("runs");
    assert_eq!(
        (end(&outcome, "unwrap"), end(&outcome, "other")),
        (&ProcessEnd::Refused("why".into()), &ProcessEnd::ShutDown)
    );
    assert!(failed(&outcome));
}

/// A detector whose steps took longer than the limit was killed in each of them, and answered no frame.
#[tokio::test]
async fn a_long_step_that_computes_is_no_hang() {
    let files = Files::new("launch:\n  - node: { pkg: modulo, exec: unwrap, respawn: 'true' }\n");
    let script = r#"report() { echo "{\"node\": \"/unwrap\", \"running\": true}" > "$MODULO_REPORT_DIR/unwrap.$1.json"; }
seconds() { read now _ < /proc/uptime; now=${now%.*}; }
[ -e "$MODULO_STATE_DIR/waited" ] && exit 0
report 1; sleep 0.6; report 1
seconds; end=$((now + 5))
while [ $now -lt $end ]; do seconds; done
echo computed; report 1
touch "$MODULO_STATE_DIR/waited"; sleep 1000"#;
    let lines = Lines::default();
    let hang_timeout = Some(Duration::from_secs(1));
    let how = Supervision { hang_timeout, ..lines.supervision(&suite(&files, script)) };
    let outcome = run_until(files.resolve(&[]).expect("resolves"), &how, pending()).await.expect("runs");
    assert_eq!((end(&outcome, "unwrap"), outcome.processes[0].restarts), (&ProcessEnd::Exited, 1));
    let shown = lines.all();
    assert_eq!(shown[0], "[unwrap] computed");
    assert!(shown[1].contains("no sign of life for 1 s; it is killed"), "{shown:?}");
}

/// The last frame of a slow detector was lost, and the run failed, since its step took longer than the patience of the launcher.
#[tokio::test]
async fn a_node_that_computes_at_the_end_is_waited_for() {
    let node = "{ pkg: modulo, exec: unwrap, sigterm_timeout: 1.0, sigkill_timeout: 1.0 }";
    let ready = Marks::new();
    let last = sh("last", &ready.wait(&["node"]), LAST);
    let files = Files::new(&format!("launch:\n  - node: {node}\n{last}"));
    let script = r#"seconds() { read now _ < /proc/uptime; now=${now%.*}; }
trap 'seconds; end=$((now + 4)); while [ $now -lt $end ]; do seconds; done; echo answered; exit 0' INT
"#;
    let script = format!("{script}{}; while true; do sleep 0.05; done", ready.set("node"));
    let lines = Lines::default();
    let how = lines.supervision(&suite(&files, &script));
    let outcome = run_until(files.resolve(&[]).expect("resolves"), &how, pending()).await.expect("runs");
    assert_eq!(end(&outcome, "unwrap"), &ProcessEnd::ShutDown);
    assert_eq!(lines.all(), ["[unwrap] answered"]);
}

/// Ctrl-C beside a detector whose step takes long: the launcher killed it, and said that it had crashed.
#[tokio::test]
async fn a_node_that_the_launcher_kills_at_the_end_has_not_crashed() {
    let node = "{ pkg: modulo, exec: unwrap, sigterm_timeout: 1.0, sigkill_timeout: 1.0 }";
    let (files, lines) = (Files::new(&format!("launch:\n  - node: {node}\n")), Lines::default());
    let how = lines.supervision(&suite(&files, "trap '' INT TERM; echo computes; while true; do :; done"));
    let plan = files.resolve(&[]).expect("resolves");
    let outcome = run_until(plan, &how, lines.wait_for("[unwrap] computes")).await.expect("runs");
    assert!(!failed(&outcome));
    // With these, the command ends with exit status 3.
    assert_eq!(outcome.summary().with_loss, ["unwrap was ended by SIGKILL while it computed"]);
}

/// A file on a network drive that is away for a moment ended the whole launch.
#[tokio::test]
async fn a_refusal_at_a_restart_is_tried_again() {
    let files = Files::new("launch:\n  - node: { pkg: modulo, exec: unwrap, respawn: 'true' }\n");
    let script = r#"life="$MODULO_STATE_DIR/life"
echo >> "$life"
case $(wc -l < "$life") in 1) exit 7;; 2) exit 2;; esac"#;
    let how = Lines::default().supervision(&suite(&files, script));
    let outcome = run_until(files.resolve(&[]).expect("resolves"), &how, pending()).await.expect("runs");
    assert_eq!((end(&outcome, "unwrap"), outcome.processes[0].restarts), (&ProcessEnd::Exited, 2));
    assert!(!failed(&outcome));
}

#[tokio::test]
async fn a_signal_to_the_launcher_is_an_orderly_end() {
    let lines = Lines::default();
    let script = "trap 'echo bye; exit 0' INT; echo ready; while true; do sleep 0.05; done";
    let plan = Files::new(&format!("launch:\n{}", sh("node", script, ""))).resolve(&[]).expect("resolves");
    let how = lines.supervision("/nonexistent");
    let signal = async {
        lines.wait_for("[node] ready").await;
        // The test itself is the launcher here. Its handler is there, since a process has been started
        // already.
        raise(Signal::SIGTERM).expect("sent");
    };
    let (outcome, ()) = tokio::join!(run(plan, &how), signal);
    let outcome = outcome.expect("runs");
    assert_eq!(outcome.ending, Ending::Interrupted);
    assert!(!failed(&outcome));
    assert_eq!(lines.all(), ["[node] ready", "[node] bye"]);
}

#[tokio::test]
async fn a_run_that_is_given_up_leaves_nothing_behind() {
    let lines = Lines::default();
    let plan = Files::new(&format!("launch:\n{}", sh("orphan", "echo $$; sleep 1000", "")))
        .resolve(&[])
        .expect("resolves");
    let how = lines.supervision("/nonexistent");
    let started = async {
        while lines.all().is_empty() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    tokio::select! {
        _ = run_until(plan, &how, pending()) => panic!("it does not end by itself"),
        () = started => {}
    }
    wait_for_end(&lines.all()[0].replace("[orphan] ", "")).await;
}
