//! Real frames and a real model, where the shared test data is at hand.

mod harness;

use harness::{Bench, arg, classes, data, json, text};
use serde_json::Value;

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
