//! A node that crashes is started again with its parameters, and the other nodes go on.

mod harness;

use std::time::{Duration, Instant};

use harness::{Background, Bench, Peer, arg, command_line, model, signal, text, wait_until};
use modulo_runtime::MessageKind;
use modulo_runtime::transport::Transport;

/// The names of the nodes' executables.
const NODES: [&str; 3] = ["detector", "unwrap", "modulo_camera"];

/// All three nodes, without end.
fn suite(bench: &Bench, more: &[&str]) -> Background {
    let (source, model) = (arg("source", bench.images(4)), arg("model", model()));
    let fixed = ["engine:=rten", "rate:=10", "loop:=true"];
    bench.start(&[&["launch", "launch/recovered.launch.yaml", &source, &model][..], &fixed, more].concat())
}

/// Whether a crash took a frame is a matter of timing; `tests/accounts.rs` looks at the accounts.
fn end_after_crash(running: Background) {
    let code = running.interrupt();
    assert!(matches!(code, Some(0 | 3)), "{code:?}");
}

#[test]
fn a_crashed_node_is_back_with_its_last_accepted_parameters() {
    let bench = Bench::new();
    let running = suite(&bench, &[]);
    let peer = Peer::new(&bench);
    wait_until("the camera", || peer.transport.is_ready("/modulo_camera"));
    for (name, value) in [("input", "modulo"), ("score_threshold", "0.125")] {
        let set = bench.run(&["param", "set", "/detector", name, value]);
        assert_eq!(set.status.code(), Some(0), "{}", text(&set));
    }
    let refused = bench.run(&["param", "set", "/detector", "score_threshold", "7"]);
    assert_eq!(refused.status.code(), Some(1), "{}", text(&refused));

    let [victim, unwrap, camera] =
        ["detector", "unwrap", "modulo_camera"].map(|kind| running.node(kind).expect("it runs"));
    let (_heard, detections) = peer.listen("/detector/detections", MessageKind::Detections);
    let publisher = || {
        let sample = detections.recv_timeout(Duration::from_secs(30)).expect("boxes");
        sample.attachment.expect("a node of ours sends one").gid
    };
    let first = publisher();
    let crashed = Instant::now();
    signal(victim, "KILL");
    // The attachment names the publisher: another one means that the node has a new life.
    while publisher() == first {}
    // Shown and not held to a limit, since it depends on the load of the machine.
    println!("back after {:?}", crashed.elapsed());

    for (name, value) in [("input", "modulo"), ("score_threshold", "0.125")] {
        let got = bench.run(&["param", "get", "/detector", name]);
        assert!(text(&got).contains(value), "{name}: {}", text(&got));
    }
    let now = ["unwrap", "modulo_camera"].map(|kind| running.node(kind).expect("it runs"));
    assert_eq!(now, [unwrap, camera], "the neighbours have not noticed");
    end_after_crash(running);

    // Another launch is another life.
    let running = suite(&bench, &[]);
    // The saved state belongs to the launch that has ended, so the parameter has its value from the file
    // again.
    wait_until("the next launch", || {
        let got = bench.run(&["param", "get", "/detector", "input"]);
        text(&got).contains("recovered")
    });
    assert_eq!(running.interrupt(), Some(0));
}

/// A node that stands still is not in the way for long: it is killed and started again. The others go on.
#[test]
fn a_node_that_hangs_is_replaced() {
    let bench = Bench::new();
    let running = suite(&bench, &["--hang-timeout", "4"]);
    let peer = Peer::new(&bench);
    for kind in NODES {
        let (_heard, detections) = peer.listen("/detector/detections", MessageKind::Detections);
        detections.recv_timeout(Duration::from_secs(60)).expect("boxes before the hang");
        let pids = || NODES.map(|kind| running.node(kind));
        let before = pids();
        let victim = running.node(kind).expect("it runs");
        signal(victim, "STOP");
        wait_until("another process", || running.node(kind).is_some_and(|pid| pid != victim));
        let others = pids().iter().zip(&before).filter(|(now, before)| now == before).count();
        assert_eq!(others, 2, "{kind}: the neighbours have not noticed");
        // From a new subscription on, since boxes may have waited for the old one.
        let (_heard, detections) = peer.listen("/detector/detections", MessageKind::Detections);
        detections.recv_timeout(Duration::from_secs(60)).expect("boxes after the hang");
    }
    end_after_crash(running);
}

#[test]
fn nodes_end_with_a_launcher_that_was_killed() {
    let bench = Bench::new();
    let mut running = suite(&bench, &[]);
    let mut nodes = Vec::new();
    wait_until("the nodes", || {
        nodes = NODES.iter().filter_map(|kind| running.node(kind)).collect();
        nodes.len() == 3
    });
    running.0.kill().expect("it runs");
    running.0.wait().expect("it ends");
    wait_until("the end of the nodes", || !nodes.iter().any(|&pid| !command_line(pid).is_empty()));
}
