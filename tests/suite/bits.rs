//! The bits of the sensor through the shipped binary: each stream is read as its samples are meant, in lockstep, live, compressed and from a
//! bag.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value;

use crate::harness::{Bench, classes, json, text};

const COMPARE: &str = "launch/compare.launch.yaml";
/// It wraps, and the demonstration model finds each of its objects.
const SCENE: &str = "source:=scene://glare?seed=4&frames=2&width=480&height=192";
/// Without a size, the model would run once on a larger image.
const SENSOR: [&str; 4] = ["alpha:=2", "psf_sigma:=1.4", "engine:=rten", "input_size:=480x192"];
const STREAMS: [&str; 4] = ["modulo", "saturated", "recovered", "ideal"];

/// Evaluates the streams of a sensor of `bits` in lockstep.
fn evaluated(bench: &Bench, bits: u8, more: &[&str]) -> (Value, Value) {
    let (out, bits) = (bench.path(&format!("out{bits}")), format!("bits:={bits}"));
    let out_text = out.display().to_string();
    let arguments = ["eval", COMPARE, SCENE, &bits, "-o", &out_text];
    let output = bench.run(&[&arguments, &SENSOR[..], more].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    (json(&out.join("scores.json")), json(&out.join("summary.json")))
}

/// Where the counts are exact, the boxes of a picture do not depend on the bits of the sensor. With fewer than 4, even the ideal picture is as
/// coarse as the codes: with 3, the recovered one is its equal, and with 1 and 2 the model finds hardly anything in either.
#[test]
fn pictures_are_detected_alike_at_any_bits() {
    let bench = Bench::new();
    let ap50: BTreeMap<u8, [f64; 4]> = (1..=16)
        .map(|bits| {
            let scores = evaluated(&bench, bits, &[]).0;
            (bits, STREAMS.map(|stream| scores[stream]["ap50"].as_f64().expect("a score")))
        })
        .collect();
    ap50.iter().for_each(|(bits, of_streams)| println!("{bits} bits: AP50 of {STREAMS:?}: {of_streams:.3?}"));
    let [_, saturated, recovered, ideal] = ap50[&8];
    assert_eq!([saturated, recovered, ideal], [1.0; 3]);
    for (bits, of_streams) in ap50.range(4..) {
        assert_eq!(of_streams[1..], [saturated, recovered, ideal], "{bits} bits");
    }
    assert_eq!(ap50[&3][2], ap50[&3][3], "3 bits: the counts are exact");
}

/// Checks that a run of `arguments` has the detections of `expected` on each stream.
fn check(bench: &Bench, arguments: &[&str], expected: &Value) {
    let file = bench.path("live.json");
    let summary = ["--summary", file.to_str().expect("UTF-8")];
    let output = bench.run(&[&["launch"], arguments, &summary].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let got = json(&file);
    for stream in STREAMS {
        let found = classes(&got, stream);
        assert_eq!(found, classes(expected, stream), "{stream}, {arguments:?}");
    }
    assert!(!classes(&got, "ideal").is_empty() && !classes(&got, "recovered").is_empty());
}

fn written(bench: &Bench, name: &str, text: &str) -> String {
    let file = bench.path(name);
    std::fs::write(&file, text).expect("a writable folder");
    file.display().to_string()
}

#[test]
fn live_compressed_and_replayed_streams_are_read_as_in_lockstep() {
    let bench = Bench::new();
    let share = Path::new(env!("CARGO_MANIFEST_DIR")).display();
    let compressed = format!(
        "launch:\n  - set_parameter: {{ name: image_transport, value: compressed }}\n  - set_parameter: {{ name: compressed_format, value: \
         png }}\n  - include: {{ file: {share}/{COMPARE} }}\n"
    );
    let compressed = written(&bench, "compressed.launch.yaml", &compressed);
    for bits in [5, 10] {
        let bag = bench.path(&format!("bag{bits}")).display().to_string();
        let topics = STREAMS.map(|stream| format!("/{stream}"));
        let topics: Vec<&str> = topics.iter().map(String::as_str).chain(["/sensor_info"]).collect();
        let (_, expected) = evaluated(&bench, bits, &[&["--bag", &bag, "--topics"], &topics[..]].concat());

        let bits = format!("bits:={bits}");
        let camera = [&["--compose", SCENE, &bits], &SENSOR[..]].concat();
        check(&bench, &[&[COMPARE], &camera[..]].concat(), &expected);
        check(&bench, &[&[&*compressed, "image_transport:=compressed"], &camera[..]].concat(), &expected);

        let detectors = STREAMS.map(|stream| {
            let arguments = [
                ("detector", &*format!("detector_{stream}")),
                ("input", stream),
                ("engine", "rten"),
                ("input_size", "480x192"),
            ];
            let arguments =
                arguments.map(|(name, value)| format!("{{ name: {name}, value: {value} }}")).join(", ");
            format!("  - include: {{ file: {share}/launch/detector.launch.yaml, arg: [{arguments}] }}\n")
        });
        let nodes = STREAMS.map(|stream| format!("/detector_{stream}")).join(" ");
        let player = format!(
            "  - executable: {{ name: player, cmd: modulo bag play {bag} --rate 0 --wait-for {nodes}, on_exit: shutdown }}\n"
        );
        let replay =
            written(&bench, "replay.launch.yaml", &format!("launch:\n{}{player}", detectors.concat()));
        check(&bench, &[&replay], &expected);
    }
}
