//! The bag that comes with the project: a few seconds of the tunnel.

mod harness;

use std::path::{Path, PathBuf};

use harness::{Bench, arg, classes, json, text};

fn sample() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("bags/samples/tunnel")
}

/// The command of docs/bags.md makes the very bytes that are committed.
#[test]
fn the_sample_is_made_by_its_command() {
    let bench = Bench::new();
    let (bag, out) = (bench.path("tunnel"), bench.path("out"));
    let source = "source:=scene://tunnel?seed=3&frames=12";
    let output = bench.run(&[
        "eval",
        "launch/recovered.launch.yaml",
        source,
        "rate:=4",
        "engine:=rten",
        "-o",
        out.to_str().expect("UTF-8"),
        "--bag",
        bag.to_str().expect("UTF-8"),
        "--topics",
        "/modulo",
        "/sensor_info",
        "/ground_truth",
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    for file in ["tunnel_0.mcap", "metadata.yaml"] {
        let [made, committed] =
            [bag.join(file), sample().join(file)].map(|p| std::fs::read(p).expect("readable"));
        assert!(made == committed, "{file} differs from the committed one");
    }
}

#[test]
fn the_sample_replayed_shows_traffic() {
    let bench = Bench::new();
    let bag = arg("bag", sample());
    let summary = bench.path("summary.json");
    let file = summary.display().to_string();
    let arguments =
        ["launch", "launch/replay.launch.yaml", &bag, "play_rate:=0.5", "engine:=rten", "--summary", &file];
    let output = bench.run(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let summary = json(&summary);
    assert_eq!(summary["topics"]["/detector/detections"]["out"], 12, "{summary}");
    assert!(classes(&summary, "recovered")["car"] >= 30, "{summary}");
}
