//! Recorded frames: the sample bag that comes with the project, and real frames where the shared test data is at hand.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::harness::{Bench, arg, classes, data, json, text};

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
        ["launch", "launch/replay.launch.yaml", &bag, "play_rate:=0", "engine:=rten", "--summary", &file];
    let output = bench.run(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let summary = json(&summary);
    // At rate 0 the player waits for the nodes, so that a busy machine replaces no frame.
    let count = |topic: &str, field: &str| summary["topics"][topic][field].as_u64().expect("a count");
    assert_eq!(count("/detector/detections", "out"), 12, "{summary}");
    assert_eq!(count("/modulo", "dropped") + count("/recovered", "dropped"), 0, "{summary}");
    assert!(classes(&summary, "recovered")["car"] >= 30, "{summary}");
}

fn boxes(file: &Value) -> Vec<&Vec<Value>> {
    let frames = file.as_object().expect("frames");
    frames
        .values()
        .flat_map(|frame| frame.as_array().expect("boxes"))
        .map(|b| b.as_array().expect("a box"))
        .collect()
}

#[test]
fn cars_and_persons_are_found_on_the_recovered_stream() {
    let data = [("source", "data/kitti_object"), ("model", "models/yolov10n_dyn_w16.onnx")];
    let [Some(source), Some(model)] = data.map(|(name, path)| Some(arg(name, data::shared(path)?))) else {
        return;
    };
    let bench = Bench::new();
    let out = bench.path("out");
    let folder = out.to_str().expect("UTF-8");
    let fixed =
        ["eval", "launch/recovered.launch.yaml", "psf_sigma:=1.4", "engine:=rten", "alpha:=2", "-o", folder];
    let output = bench.run(&[&fixed[..], &[&source, &model]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let summary = json(&out.join("summary.json"));
    assert_eq!(summary["frames"], 20, "{summary}");
    let found = classes(&summary, "recovered");
    assert!(found["car"] >= 60, "{found:?}");
    assert!(found["person"] >= 5, "{found:?}");
    let file = json(&out.join("recovered.json"));
    assert_eq!(file.as_object().expect("frames").len(), 20);
    for b in boxes(&file) {
        let [x1, y1, x2, y2] = [0, 1, 2, 3].map(|i| b[i].as_f64().expect("a number"));
        assert!(0.0 <= x1 && x1 < x2 && x2 <= 1242.0 && 0.0 <= y1 && y1 < y2 && y2 <= 376.0, "{b:?}");
    }
}
