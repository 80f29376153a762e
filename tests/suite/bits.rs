//! The bits of the sensor through the shipped binary: each stream is read as its samples are meant, in lockstep, live, compressed and from a
//! bag.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use modulo_bags::bag::{BagReader, Selection};
use serde_json::Value;

use crate::harness::{Bench, cell, classes, evaluated_classes};

const COMPARE: &str = "launch/compare.launch.yaml";
/// It wraps, and the demonstration model finds each of its objects. Without a size, the model would run once on a larger image.
const SENSOR: &str = "source:=scene://glare?seed=4&frames=2&width=480&height=192 alpha:=2 psf_sigma:=1.4 engine:=rten \
                      input_size:=480x192";
const STREAMS: [&str; 4] = ["modulo", "saturated", "recovered", "ideal"];

/// Evaluates the streams of a sensor of `bits` in lockstep.
fn evaluated(bench: &Bench, bits: u8, more: &str) -> PathBuf {
    let out = format!("out{bits}");
    bench.says(0, &format!("eval {COMPARE} {SENSOR} bits:={bits} -o @/{out} {more}"));
    bench.path(&out)
}

/// The mean AP50 of the groups with an object.
fn ap50(cell: &Value) -> f64 {
    let groups = cell["ap50"].as_object().expect("groups").values().filter_map(Value::as_f64);
    let all: Vec<f64> = groups.collect();
    all.iter().sum::<f64>() / all.len() as f64
}

/// Where the counts are exact, the boxes of a picture do not depend on the bits of the sensor. With fewer than 4, even the ideal picture is as
/// coarse as the codes: with 3, the recovered one is its equal, and with 1 and 2 the model finds hardly anything in either.
#[test]
fn pictures_are_detected_alike_at_any_bits() {
    let bench = Bench::new();
    let ap50: BTreeMap<u8, [f64; 4]> = (1..=16)
        .map(|bits| {
            let out = evaluated(&bench, bits, "");
            (bits, STREAMS.map(|stream| ap50(&cell(&out, stream))))
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

/// Checks that a run has the detections of `expected` on each stream.
fn check(bench: &Bench, line: &str, expected: &Path) {
    bench.says(0, &format!("launch {line} --summary @/live.json"));
    let got = bench.json("live.json");
    for stream in STREAMS {
        assert_eq!(classes(&got, stream), evaluated_classes(expected, stream), "{stream}, {line}");
    }
    assert!(!classes(&got, "ideal").is_empty() && !classes(&got, "recovered").is_empty());
}

fn write(bench: &Bench, name: &str, actions: &str) {
    std::fs::write(bench.path(name), format!("launch:\n{actions}")).expect("a writable folder");
}

/// Writes copies of the shipped launch files, in which the camera and unwrap compress their images.
fn write_compressed(bench: &Bench) {
    let shipped = |file: &str| {
        std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).expect("readable")
    };
    let compress = "      param:\n        - { name: image_transport, value: compressed }\n        \
                    - { name: compressed_format, value: png }\n";
    let sensor = shipped("launch/sensor.launch.yaml").replace("      param:\n", compress);
    let compare = shipped(COMPARE).replace("$(find-pkg-share modulo)/launch/sensor", "$(dirname)/sensor");
    assert!(sensor.matches(compress).count() >= 2 && compare.contains("$(dirname)/sensor"));
    std::fs::write(bench.path("sensor.launch.yaml"), sensor).expect("a writable folder");
    std::fs::write(bench.path("compressed.launch.yaml"), compare).expect("a writable folder");
}

#[test]
fn live_compressed_and_replayed_streams_are_read_as_in_lockstep() {
    let bench = Bench::new();
    let share = Path::new(env!("CARGO_MANIFEST_DIR")).display();
    write_compressed(&bench);
    for bits in [5, 10] {
        let bag = bench.path(&format!("bag{bits}")).display().to_string();
        let topics = STREAMS.map(|stream| format!("/{stream}")).join(" ");
        let expected = evaluated(&bench, bits, &format!("--bag {bag} --topics {topics} /sensor_info"));

        let camera = format!("--compose {SENSOR} bits:={bits}");
        check(&bench, &format!("{COMPARE} {camera}"), &expected);
        check(&bench, &format!("@/compressed.launch.yaml image_transport:=compressed {camera}"), &expected);

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
        write(&bench, "replay.launch.yaml", &(detectors.concat() + &player));
        check(&bench, "@/replay.launch.yaml", &expected);
    }
}

/// All streams for a detector.
const ALL: [&str; 6] = ["modulo", "recovered", "metered", "saturated", "auto_exposed", "ideal"];

/// Returns the topics of all streams; the names of remapped ones end with that of another stream.
fn topics(is_remapped: bool) -> [String; 6] {
    std::array::from_fn(|at| {
        if is_remapped { format!("/x/{}", ALL[(at + 1) % 6]) } else { format!("/{}", ALL[at]) }
    })
}

/// Writes a launch file with a detector for the declared name of each stream, and with one for its topic.
fn write_remapped(bench: &Bench, is_remapped: bool) {
    let share = Path::new(env!("CARGO_MANIFEST_DIR")).display();
    let mut actions = String::new();
    for (stream, topic) in ALL.iter().zip(topics(is_remapped)) {
        actions += &format!("  - set_remap: {{ from: {stream}, to: {topic} }}\n");
    }
    let detectors: Vec<_> = ALL.iter().map(|stream| format!("of_{stream}, at_{stream}")).collect();
    let argument = |name, value: &str| format!("{{ name: {name}, value: \"{value}\" }}");
    let of_sensor = [
        argument("source", "scene://glare?seed=4&frames=2&width=480&height=192"),
        argument("alpha", "2.0"),
        argument("bits", "6"),
        argument("detectors", &format!("[{}]", detectors.join(", "))),
    ];
    let include = |file: &str, arguments: &[String]| {
        format!("  - include: {{ file: {share}/launch/{file}, arg: [{}] }}\n", arguments.join(", "))
    };
    actions += &include("sensor.launch.yaml", &of_sensor);
    for (stream, topic) in ALL.iter().zip(topics(is_remapped)) {
        for (name, input) in [(format!("of_{stream}"), *stream), (format!("at_{stream}"), &*topic)] {
            let engine = [argument("engine", "rten"), argument("input_size", "480x192")];
            let own = [argument("detector", &name), argument("input", input)];
            actions += &include("detector.launch.yaml", &[own, engine].concat());
        }
    }
    write(bench, "remapped.launch.yaml", &actions);
}

/// The name of a topic says nothing of its samples: boxes and annotated images are those of the declared names, and so is what the bag says.
#[test]
fn remapped_streams_are_read_as_their_samples_are_meant() {
    let bench = Bench::new();
    let outputs = ALL.iter().flat_map(|stream| {
        ["of", "at"].iter().flat_map(move |kind| {
            ["detections", "annotated"].map(|output| format!("/{kind}_{stream}/{output}"))
        })
    });
    let outputs: Vec<String> = outputs.collect();
    let messages = [false, true].map(|is_remapped| {
        write_remapped(&bench, is_remapped);
        let (out, recorded) = (format!("out{is_remapped}"), topics(is_remapped).join(" "));
        let more = "/sensor_info /recovered/sensor_info";
        let bag = format!("--bag @/bag{is_remapped} --topics {} {recorded} {more}", outputs.join(" "));
        bench.says(0, &format!("eval @/remapped.launch.yaml -o @/{out} {bag}"));
        let bag = BagReader::open(&bench.path(&format!("bag{is_remapped}"))).expect("a bag");
        let of = |topic: &String| -> Vec<Vec<u8>> {
            let messages = bag.messages(&Selection::of([topic.clone()]));
            messages.map(|message| message.expect("readable").data.to_vec()).collect()
        };
        outputs.iter().map(of).collect::<Vec<_>>()
    });
    let [expected, remapped] = messages;
    for (at, topic) in outputs.iter().enumerate() {
        assert_eq!(expected[at].len(), 2, "{topic}");
        assert!(expected[at] == remapped[at], "{topic} differs where its input is remapped");
        // That of the declared name.
        assert!(expected[at] == expected[at / 4 * 4 + at % 2], "{topic} differs where its input is a topic");
    }
}
