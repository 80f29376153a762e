//! Promise 5: what crashes is back, as it was, and nobody else notices.

mod harness;

use std::process::Command;
use std::time::{Duration, Instant};

use harness::peer::Peer;
use harness::{Background, Bench, arg, model, text, wait_until};
use modulo_runtime::MessageKind;
use modulo_runtime::transport::Transport;

/// All three nodes, without end.
fn suite(bench: &Bench) -> Background {
    let (source, model) = (arg("source", bench.images(4)), arg("model", model()));
    let more = ["engine:=rten", "rate:=10", "loop:=true"];
    bench.start(&[&["launch", "launch/recovered.launch.yaml", &source, &model][..], &more].concat())
}

/// Process ids of the nodes of `launcher`, by the node's kind.
fn node(launcher: &Background, kind: &str) -> Option<String> {
    let parent = launcher.0.id().to_string();
    let found = Command::new("pgrep").args(["-P", &parent, "-f", &format!("run {kind}")]).output();
    let found = String::from_utf8(found.expect("pgrep runs").stdout).expect("numbers");
    found.lines().next().map(str::to_owned)
}

fn kill(pid: &str) {
    assert!(Command::new("kill").args(["-KILL", pid]).status().expect("kill runs").success());
}

fn is_alive(pid: &str) -> bool {
    Command::new("kill").args(["-0", pid]).output().expect("kill runs").status.success()
}

#[test]
fn a_crashed_node_is_back_with_its_last_accepted_parameters() {
    let bench = Bench::new(131);
    let running = suite(&bench);
    let peer = Peer::new(&bench);
    wait_until("the camera", || peer.transport.is_ready("/modulo_camera"));
    for (name, value) in [("input", "modulo"), ("score_threshold", "0.125")] {
        let set = bench.run(&["param", "set", "/detector", name, value]);
        assert_eq!(set.status.code(), Some(0), "{}", text(&set));
    }
    let refused = bench.run(&["param", "set", "/detector", "score_threshold", "7"]);
    assert_eq!(refused.status.code(), Some(1), "{}", text(&refused));

    let [victim, unwrap, camera] =
        ["detector", "unwrap", "modulo_camera"].map(|kind| node(&running, kind).expect("it runs"));
    let detections = peer.hear("/detector/detections", MessageKind::Detections);
    detections.until("boxes before the crash", |_| true);
    kill(&victim);
    let crashed = Instant::now();
    wait_until("the crash", || node(&running, "detector").is_none_or(|pid| pid != victim));
    while detections.next(Duration::ZERO).is_some() {}
    detections.until("boxes after the crash", |_| true);
    let back = crashed.elapsed();
    println!("back after {back:?}");
    assert!(back < Duration::from_secs(2), "{back:?}");

    for (name, value) in [("input", "modulo"), ("score_threshold", "0.125")] {
        let got = bench.run(&["param", "get", "/detector", name]);
        assert!(text(&got).contains(value), "{name}: {}", text(&got));
    }
    let now = ["unwrap", "modulo_camera"].map(|kind| node(&running, kind).expect("it runs"));
    assert_eq!(now, [unwrap, camera], "the neighbours have not noticed");
    assert_eq!(running.interrupt(), Some(0));

    // Another launch is another life.
    let running = suite(&bench);
    wait_until("the next launch", || {
        let got = bench.run(&["param", "get", "/detector", "input"]);
        text(&got).contains("recovered")
    });
    assert_eq!(running.interrupt(), Some(0));
}

#[test]
fn nodes_end_with_a_launcher_that_was_killed() {
    let bench = Bench::new(132);
    let mut running = suite(&bench);
    wait_until("the nodes", || node(&running, "modulo_camera").is_some());
    let nodes = ["detector", "unwrap", "modulo_camera"].map(|kind| node(&running, kind).expect("it runs"));
    running.0.kill().expect("it runs");
    running.0.wait().expect("it ends");
    let start = Instant::now();
    wait_until("the end of the nodes", || !nodes.iter().any(|pid| is_alive(pid)));
    assert!(start.elapsed() < Duration::from_secs(10), "{:?}", start.elapsed());
}
