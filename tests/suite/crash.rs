//! A node that crashes is started again with its parameters, and the other nodes go on. Frames know their sensor: a change of
//! the camera reaches the other nodes with the very frame that it concerns.

use std::collections::BTreeMap;
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use modulo_middleware::transport::Transport;
use modulo_runtime::sensor_info::SensorHistory;
use modulo_runtime::{Message, MessageKind};

use crate::harness::{
    Background, Bench, Peer, assert_has, borrowed, command_line, model, signal, text, wait_until,
};
use modulo_core::Frame;

/// The names of the nodes' executables.
const NODES: [&str; 3] = ["detector", "unwrap", "modulo_camera"];

/// All three nodes, without end.
fn suite(bench: &Bench, more: &str) -> Background {
    bench.images(4);
    let fixed = "source:=@/images model:=% engine:=rten rate:=10 loop:=true";
    bench.starts(&format!("launch launch/recovered.launch.yaml {fixed} {more}"))
}

/// Whether a crash took a frame is a matter of timing; `accounts.rs` looks at the accounts.
fn end_after_crash(running: Background) {
    let code = running.interrupt();
    assert!(matches!(code, Some(0 | 3)), "{code:?}");
}

#[test]
fn a_crashed_node_is_back_with_its_last_accepted_parameters() {
    let bench = Bench::new();
    let running = suite(&bench, "");
    let peer = Peer::new(&bench);
    wait_until("the camera", || peer.transport.is_ready("/modulo_camera"));
    bench.says(0, "param set /detector input modulo");
    bench.says(0, "param set /detector score_threshold 0.125");
    bench.says(1, "param set /detector score_threshold 7");

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

    assert_has(&bench.says(0, "param get /detector input"), &["modulo"]);
    assert_has(&bench.says(0, "param get /detector score_threshold"), &["0.125"]);
    let now = ["unwrap", "modulo_camera"].map(|kind| running.node(kind).expect("it runs"));
    assert_eq!(now, [unwrap, camera], "the neighbours have not noticed");
    end_after_crash(running);

    // Another launch is another life.
    let running = suite(&bench, "");
    // The saved state belongs to the launch that has ended, so the parameter has its value from the file
    // again.
    wait_until("the next launch", || {
        text(&bench.run(&["param", "get", "/detector", "input"])).contains("recovered")
    });
    assert_eq!(running.interrupt(), Some(0));
}

/// A source that was set at run time and has been removed since does not keep the camera from starting again.
#[test]
fn a_node_whose_accepted_parameters_are_not_possible_any_more_takes_those_of_its_launch() {
    let bench = Bench::new();
    let running = suite(&bench, "--max-restarts 1");
    let peer = Peer::new(&bench);
    let detections = peer.hear("/detector/detections", MessageKind::Detections);
    detections.until("boxes", |_| true);
    let other = bench.path("other");
    std::fs::create_dir(&other).expect("a writable folder");
    std::fs::copy(bench.path("images").join("000000.png"), other.join("0.png")).expect("copied");
    peer.set("/modulo_camera", "source", &other.display().to_string()).expect("possible");
    std::fs::remove_dir_all(&other).expect("removed");
    let victim = running.node("modulo_camera").expect("it runs");
    signal(victim, "KILL");
    wait_until("another camera", || running.node("modulo_camera").is_some_and(|pid| pid != victim));
    while detections.next(Duration::ZERO).is_some() {}
    detections.until("boxes after the crash", |_| true);
    assert_has(&bench.says(0, "param get /modulo_camera source"), &["images"]);
    end_after_crash(running);
}

/// A node that stands still is not in the way for long: it is killed and started again. The others go on.
/// `MODULO_CRASH_ROUNDS` is how often each node is stopped; once if it is not set.
#[test]
fn a_node_that_hangs_is_replaced() {
    let rounds = std::env::var("MODULO_CRASH_ROUNDS").map_or(1, |text| text.parse().expect("a number"));
    let bench = Bench::new();
    let running = suite(&bench, "--hang-timeout 4");
    let peer = Peer::new(&bench);
    for kind in std::iter::repeat_n(NODES, rounds).flatten() {
        let (_heard, detections) = peer.listen("/detector/detections", MessageKind::Detections);
        detections.recv_timeout(Duration::from_secs(60)).expect("boxes before the hang");
        let pids = || NODES.map(|kind| running.node(kind));
        let before = pids();
        let victim = running.node(kind).expect("it runs");
        signal(victim, "STOP");
        wait_until("another process", || running.node(kind).is_some_and(|pid| pid != victim));
        let replaced = Instant::now();
        let others = pids().iter().zip(&before).filter(|(now, before)| now == before).count();
        assert_eq!(others, 2, "{kind}: the neighbours have not noticed");
        // From a new subscription on, since boxes may have waited for the old one.
        let (_heard, detections) = peer.listen("/detector/detections", MessageKind::Detections);
        detections.recv_timeout(Duration::from_secs(60)).expect("boxes after the hang");
        // Shown and not held to a limit, since it depends on the load of the machine.
        println!("{kind} is back {:?} after it was killed", replaced.elapsed());
    }
    end_after_crash(running);
}

/// A file that a node needs was removed, so that each start fails. The run ends, and the last line names the node, the count
/// and the reason.
#[test]
fn a_node_that_crashes_at_each_start_ends_the_run() {
    for (kind, file, reason) in [("modulo_camera", "images", "source"), ("detector", "rows.onnx", "model")] {
        let bench = Bench::new();
        bench.images(4);
        std::fs::copy(model(), bench.path("rows.onnx")).expect("copied");
        let fixed = "source:=@/images model:=@/rows.onnx engine:=rten rate:=10 loop:=true";
        let words = bench.words(&format!("launch launch/recovered.launch.yaml --max-restarts 2 {fixed}"));
        let words = borrowed(&words);
        let child = bench.modulo(&words).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
        let running = Background(child.expect("the binary starts"));
        let peer = Peer::new(&bench);
        wait_until("the camera", || peer.transport.is_ready("/modulo_camera"));
        std::fs::rename(bench.path(file), bench.path("gone")).expect("renamed");
        signal(running.node(kind).expect("it runs"), "KILL");
        let (code, message) = running.errors();
        let last = message.lines().last().unwrap_or_default();
        let crashes = format!("{kind} crashed 3 times within a minute, the last time with exit status: 2");
        assert!(code == Some(1) && last.contains(&crashes) && last.contains(reason), "{code:?} {message}");
        assert!(last.contains("--max-restarts"), "{last}");
    }
}

#[test]
fn nodes_end_with_a_launcher_that_was_killed() {
    let bench = Bench::new();
    let mut running = suite(&bench, "");
    let mut nodes = Vec::new();
    wait_until("the nodes", || {
        nodes = NODES.iter().filter_map(|kind| running.node(kind)).collect();
        nodes.len() == 3
    });
    let environment = std::fs::read_to_string(format!("/proc/{}/environ", nodes[0])).expect("it runs");
    let reports = environment.split('\0').find_map(|entry| entry.strip_prefix("MODULO_REPORT_DIR="));
    let reports = std::path::PathBuf::from(reports.expect("a launcher names it"));
    running.0.kill().expect("it runs");
    running.0.wait().expect("it ends");
    wait_until("the end of the nodes", || !nodes.iter().any(|&pid| !command_line(pid).is_empty()));
    // What it has left in memory is removed by the next launcher.
    assert!(reports.is_dir(), "{}", reports.display());
    bench.says(0, "launch launch/raw.launch.yaml source:=scene://day?frames=1&width=64&height=32");
    assert!(!reports.exists(), "{}", reports.display());
}

const ALPHAS: [&str; 4] = ["2.0", "3.0", "2.5", "4.0"];

/// While alpha changes 200 times at 30 Hz on a busy machine, each recovered frame equals the ideal
/// one of the same exposure. A frame that was unwrapped with the alpha of another
/// frame would differ: its scale, and most of its wraps, would be wrong.
#[test]
fn no_frame_is_unwrapped_with_the_alpha_of_another() {
    let bench = Bench::new();
    let source = "source:=scene://tunnel?seed=3&frames=100000";
    let camera = ["-p", source, "-p", "psf_sigma:=1.4", "-p", "rate:=30", "-p", "wait_for:=[unwrap]"];
    let _unwrap = bench.start(&["run", "unwrap"]);
    let peer = Peer::new(&bench);
    let [ideal, recovered] = ["/ideal", "/recovered"].map(|topic| peer.hear(topic, MessageKind::Image));
    let described = peer.hear("/sensor_info", MessageKind::Diagnostics);
    let running = bench.start(&[&["run", "modulo_camera", "--ros-args"][..], &camera].concat());
    wait_until("the camera", || peer.transport.is_ready("/modulo_camera"));

    let loaded = Arc::new(AtomicBool::new(true));
    // The load lets frames and descriptions arrive late and in bursts, which is when they could be mixed up.
    for _ in 0..2 {
        let loaded = loaded.clone();
        std::thread::spawn(move || while loaded.load(Ordering::Relaxed) {});
    }
    let (mut ideals, mut recoveries) = (BTreeMap::<u64, Frame>::new(), BTreeMap::<u64, Frame>::new());
    let (mut sensors, mut alphas) = (SensorHistory::default(), BTreeMap::new());
    let mut compared = BTreeMap::new();
    // 200 changes, and on a slow machine more, until enough frames have been compared.
    let enough = |compared: &BTreeMap<_, i32>| compared.values().sum::<i32>() >= 60;
    for change in 0..2000 {
        if change >= 200 && enough(&compared) {
            break;
        }
        peer.set("/modulo_camera", "alpha", ALPHAS[change % ALPHAS.len()]).expect("possible");
        for (heard, frames) in [(&ideal, &mut ideals), (&recovered, &mut recoveries)] {
            while let Some(Message::Image(image)) = heard.next(Duration::from_millis(8)) {
                frames.insert(image.header.stamp.as_ns(), image.frame.clone());
            }
        }
        while let Some(Message::Diagnostics(info)) = described.next(Duration::ZERO) {
            sensors.note(&info).expect("a sensor");
            let alpha = sensors.of(info.header.stamp).expect("just taken").alpha;
            alphas.insert(info.header.stamp.as_ns(), alpha);
        }
        // Either of the two images may come first: a recovered one waits here for its ideal one.
        recoveries.retain(|stamp, frame| {
            let Some(expected) = ideals.remove(stamp) else { return true };
            let alpha = alphas[stamp];
            assert!(*frame == expected, "the frame of {stamp} ns, alpha {alpha}, differs");
            *compared.entry(alpha.to_string()).or_insert(0) += 1;
            false
        });
    }
    loaded.store(false, Ordering::Relaxed);
    drop(running);
    println!("compared frames by alpha: {compared:?}");
    assert_eq!(compared.len(), ALPHAS.len(), "{compared:?}");
    assert!(enough(&compared), "{compared:?}");
}
