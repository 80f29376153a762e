//! `modulo eval FILE`: every camera is scored, what cannot be evaluated is refused before anything is written, and what was evaluated is not
//! lost.

use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Output;

use serde_json::Value;

use crate::harness::{Bench, arg, json, model, text, wait_until};

const CAMERAS: &str = "launch/cameras.launch.yaml";
const RECOVERED: &str = "launch/recovered.launch.yaml";
/// Scenes of other sizes and lengths, whose labels differ.
const FRONT: &str = "scene://tunnel?seed=3&frames=3";
const REAR: &str = "scene://glare?seed=4&frames=2&width=256&height=160";

fn eval(bench: &Bench, out: &Path, words: &[&str]) -> Output {
    let out = out.display().to_string();
    let engine: &[&str] = if words[0].starts_with("launch/") { &["engine:=rten"] } else { &[] };
    bench.run(&[&["eval", words[0]], engine, &words[1..], &["-o", &out]].concat())
}

fn frames(file: &Path) -> usize {
    json(file).as_object().expect("frames").len()
}

/// Each camera has the boxes and the score that it has alone, with a detector of its own and with one that reads both.
#[test]
fn every_camera_is_scored_against_its_own_objects() {
    let bench = Bench::new();
    let (front, rear) = (format!("front:={FRONT}"), format!("rear:={REAR}"));
    let alone = [("front", FRONT), ("rear", REAR)].map(|(name, source)| {
        let out = bench.path(name);
        let output = eval(&bench, &out, &[RECOVERED, &format!("source:={source}")]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
        (json(&out.join("recovered.json")), json(&out.join("scores.json"))["recovered"].clone())
    });
    assert!(alone[0].1["ap50"].as_f64() > Some(0.5) && alone[1].1["ap50"].as_f64() > Some(0.5), "{alone:?}");
    for shared in ["shared:=false", "shared:=true"] {
        let out = bench.path(shared);
        let output = eval(&bench, &out, &[CAMERAS, &front, &rear, shared, "--images"]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
        let scores = json(&out.join("scores.json"));
        for (name, (boxes, score)) in ["front.recovered", "rear.recovered"].iter().zip(&alone) {
            assert_eq!(&json(&out.join(format!("{name}.json"))), boxes, "{shared} {name}");
            assert_eq!(&scores[name], score, "{shared} {name}");
            let line = text(&output).lines().any(|line| line.starts_with(&format!("AP50 on {name} ")));
            assert!(line, "{shared} {name}: {}", text(&output));
        }
        assert!(
            out.join("rear.recovered/000001.png").is_file()
                && !out.join("rear.recovered/000002.png").exists()
        );
        // Both, although they have other sizes and one ends first.
        let sheet = image::open(out.join("grid.png")).expect("an image");
        assert_eq!((sheet.width(), sheet.height()), (640 + 6 + 640, 24 + 192 + 24), "{shared}");
    }
}

/// Two detectors of one stream have results of their own.
#[test]
fn detectors_of_one_stream_have_files_of_their_own() {
    let bench = Bench::new();
    let file = bench.path("two.launch.yaml");
    let detector = |name: &str, threshold: &str| {
        format!(
            "  - node: {{ pkg: modulo, exec: detector, name: {name}, param: [{{ name: input, value: ideal }}, {{ name: engine, value: rten }}, \
             {{ name: score_threshold, value: {threshold} }}] }}\n"
        )
    };
    let camera = format!(
        "  - node: {{ pkg: modulo, exec: modulo_camera, name: camera, param: [{{ name: source, value: \"{FRONT}\" }}] }}\n"
    );
    let lines = ["launch:\n", &camera, &detector("low", "0.05"), &detector("high", "0.5")].concat();
    std::fs::write(&file, lines).expect("writable");
    let out = bench.path("out");
    let output = bench.run(&["eval", &file.display().to_string(), "-o", &out.display().to_string()]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let [low, high] = ["ideal.low.json", "ideal.high.json"].map(|name| out.join(name));
    assert_eq!((frames(&low), frames(&high)), (3, 3), "{}", text(&output));
    let boxes = |file: &Path| -> usize {
        let frames = json(file);
        frames.as_object().expect("frames").values().map(|boxes| boxes.as_array().expect("boxes").len()).sum()
    };
    assert!(boxes(&low) > boxes(&high) && boxes(&high) > 0, "{} {}", boxes(&low), boxes(&high));
}

/// A launch file of a camera `name` and a detector of `input`, which are `more`.
fn launch_file(bench: &Bench, name: &str, lines: &[&str]) -> String {
    let file = bench.path(name);
    let node = |line: &&str| format!("  - node: {{ pkg: modulo, {line} }}\n");
    let lines: String = lines.iter().map(node).collect();
    std::fs::write(&file, format!("launch:\n{lines}")).expect("writable");
    file.display().to_string()
}

/// Nothing runs, nothing is written, and one line says why.
#[test]
fn what_cannot_be_evaluated_is_refused_and_leaves_nothing_behind() {
    let bench = Bench::new();
    let camera =
        r#"exec: modulo_camera, param: [{ name: source, value: "scene://day?frames=2&width=96&height=64" }]"#;
    let other = camera.replace("exec: modulo_camera", "exec: modulo_camera, name: other");
    let detector = "exec: detector, param: [{ name: input, value: ideal }, { name: engine, value: rten }]";
    let foreign = detector.replace("ideal", "/elsewhere/image");
    let lone = launch_file(&bench, "lone.yaml", &[camera, &foreign]);
    let mixed = launch_file(&bench, "mixed.yaml", &[camera, &other, detector]);
    let twins = launch_file(&bench, "twins.yaml", &[camera, camera, detector]);
    let good = "source:=scene://day?frames=2&width=96&height=64";
    let [there, occupied] = ["there", "taken"].map(|name| bench.path(name).display().to_string());
    std::fs::create_dir_all(bench.path("there")).expect("writable");
    std::fs::create_dir_all(bench.path("taken/summary.json")).expect("writable");
    let bag = bench.path("bag").display().to_string();
    let source = "scene://day?frames=2&width=96&height=64";
    let cases: [(&[&str], &[&str]); 9] = [
        (&[&lone], &["/detector", "/elsewhere/image"]),
        (&[&mixed], &["/ideal", "/modulo_camera", "/other", "namespace"]),
        (&[&twins], &["/modulo_camera", "name"]),
        (&[RECOVERED, good, "loop:=true"], &["/modulo_camera", "loop:=true", "frames:="]),
        (&[RECOVERED, "source:=scene://day"], &["scene://day", "no end", "frames:="]),
        (&[RECOVERED, "source:=topic:/image"], &["topic:/image", "modulo bag record"]),
        (
            &[RECOVERED, good, "--bag", &bag, "--topics", "modulo"],
            &["--topics modulo", "/modulo", "/recovered"],
        ),
        (
            &[RECOVERED, "--source", source, "--source", "/nope", "--bag", &bag, "--topics", "/modulo"],
            &["/nope"],
        ),
        (&[RECOVERED, good, "--bag", &there, "--topics", "/modulo"], &[&there, "already there"]),
    ];
    for (words, named) in cases {
        let output = eval(&bench, &bench.path("out"), words);
        let message = text(&output);
        assert_eq!(output.status.code(), Some(2), "{words:?}: {message}");
        assert!(
            message.lines().count() == 1 && named.iter().all(|name| message.contains(name)),
            "{words:?}: {message}"
        );
        assert!(!bench.path("out").exists() && !bench.path("bag").exists(), "{words:?} has left something");
    }
    let output = eval(&bench, Path::new(&occupied), &[RECOVERED, good, "--bag", &bag, "--topics", "/modulo"]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert!(text(&output).contains("summary.json") && !bench.path("bag").exists(), "{}", text(&output));
    // A loop with a number of frames has an end.
    let output = eval(
        &bench,
        &bench.path("out"),
        &[
            RECOVERED,
            &format!("source:={FRONT}"),
            "loop:=true",
            "frames:=4",
            "--bag",
            &bag,
            "--topics",
            "/modulo",
        ],
    );
    assert_eq!(
        (output.status.code(), frames(&bench.path("out/recovered.json"))),
        (Some(0), 4),
        "{}",
        text(&output)
    );
}

/// The grid has the same kinds of sources and models.
#[test]
fn a_grid_without_an_end_or_a_model_is_refused() {
    let bench = Bench::new();
    let out = bench.path("out").display().to_string();
    let output = bench.run(&["eval", "--source", FRONT, "--model", "/no.onnx", "-o", &out]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert!(text(&output).contains("/no.onnx") && !bench.path("out").exists(), "{}", text(&output));
    for sources in
        [&["--source", "scene://day?width=96&height=64"][..], &["--source", FRONT, "--source", REAR]]
    {
        let output = bench.run(&[&["eval"], sources, &["-o", &out]].concat());
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        assert!(text(&output).contains("--source") && !bench.path("out").exists(), "{}", text(&output));
    }
}

#[test]
fn a_stopped_evaluation_keeps_the_frames_before() {
    let bench = Bench::new();
    let out = bench.path("out");
    let source = "source:=scene://day?seed=3&frames=100000&width=320&height=128";
    let running = bench.start(&[
        "eval",
        RECOVERED,
        source,
        "engine:=rten",
        "--images",
        "-o",
        &out.display().to_string(),
    ]);
    wait_until("two frames are there", || out.join("recovered/000001.png").is_file());
    assert_eq!(running.interrupt(), Some(3));
    assert!((2..100_000).contains(&frames(&out.join("recovered.json"))));
    assert_eq!(json(&out.join("summary.json"))["stopped"], true);
    let score = &json(&out.join("scores.json"))["recovered"];
    assert_eq!(
        (&score["stopped"], score["frames"].as_u64()),
        (&Value::Bool(true), Some(frames(&out.join("recovered.json")) as u64))
    );
}

/// The disk may be full at any time: the scores of all frames are printed, and the file is named.
#[test]
fn scores_are_printed_where_they_cannot_be_written() {
    let bench = Bench::new();
    let source = "source:=scene://day?seed=3&frames=3&width=320&height=128";
    for file in ["summary.json", "recovered.json", "recovered/000001.png"] {
        let out = bench.path(&file.replace('/', "_"));
        std::fs::create_dir_all(out.join("recovered")).expect("writable");
        symlink("/dev/full", out.join(file)).expect("writable");
        let output = eval(&bench, &out, &[RECOVERED, source, "--images"]);
        let (message, printed) = (text(&output), String::from_utf8_lossy(&output.stdout).into_owned());
        assert_eq!(output.status.code(), Some(1), "{file}: {message}");
        assert!(printed.contains("frames 3") && printed.contains("AP50 on recovered"), "{file}: {message}");
        assert!(message.contains(file), "{file}: {message}");
        assert_eq!(
            json(&out.join("scores.json"))["recovered"]["frames"],
            3,
            "{file}: the others are written"
        );
    }
}

/// A source that turns out to be bad does not take the results of those before it.
#[test]
fn a_bad_source_keeps_the_results_of_those_before_it() {
    let bench = Bench::new();
    let bad = bench.path("bad");
    std::fs::create_dir_all(&bad).expect("writable");
    // A loop without a good frame cannot go on.
    std::fs::write(bad.join("000000.png"), "no image").expect("writable");
    let (bad, out) = (bad.display().to_string(), bench.path("out"));
    let output =
        eval(&bench, &out, &[RECOVERED, "loop:=true", "frames:=3", "--source", FRONT, "--source", &bad]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert!(
        text(&output).contains("AP50 on recovered") && text(&output).contains("000000.png"),
        "{}",
        text(&output)
    );
    assert_eq!(json(&out.join("scores.json"))["recovered"]["frames"], 3);
    let bag = bench.path("bag");
    let words = [
        RECOVERED,
        "loop:=true",
        "frames:=3",
        "--source",
        &bad,
        "--topics",
        "/modulo",
        "--bag",
        &bag.display().to_string(),
    ];
    assert_eq!(eval(&bench, &bench.path("none"), &words).status.code(), Some(1));
    assert!(!bag.exists(), "no frame came before the fault");
}

/// A KITTI folder with two images and a label of `classes` for each of the first ones.
fn kitti(bench: &Bench, name: &str, classes: &[&str]) -> PathBuf {
    let folder = bench.path(name);
    std::fs::create_dir_all(folder.join("label_2")).expect("writable");
    std::fs::create_dir_all(folder.join("image_2")).expect("writable");
    for entry in std::fs::read_dir(bench.images(2)).expect("images") {
        let path = entry.expect("an image").path();
        std::fs::copy(&path, folder.join("image_2").join(path.file_name().expect("a name"))).expect("copied");
    }
    for (number, class) in classes.iter().enumerate() {
        let label = format!("{class} 0.00 0 0.0 10 10 60 60 -1 -1 -1 -1000 -1000 -1000 -10\n");
        std::fs::write(folder.join(format!("label_2/{number:06}.txt")), label).expect("writable");
    }
    folder
}

/// What is not scored is said, and is no figure.
#[test]
fn a_stream_without_a_score_says_why() {
    let bench = Bench::new();
    let model = arg("model", model());
    let cases: [(&str, &[&str], i32, &str); 3] = [
        ("unlabelled", &[], 0, "none, no frame has labels"),
        ("ignored", &["DontCare", "DontCare"], 3, "none, there is no labelled object"),
        ("partly", &["Car"], 3, "1 other frames have no labels"),
    ];
    for (name, classes, code, expected) in cases {
        let (source, out) = (arg("source", kitti(&bench, name, classes)), bench.path("out"));
        std::fs::create_dir_all(&out).expect("writable");
        std::fs::write(out.join("scores.json"), "{\"recovered\": \"of an earlier run\"}").expect("writable");
        let output = eval(&bench, &out, &[RECOVERED, &source, &model]);
        let message = text(&output);
        assert_eq!(output.status.code(), Some(code), "{name}: {message}");
        assert!(message.contains(expected), "{name}: {message}");
        let scores = std::fs::read_to_string(out.join("scores.json"));
        assert_eq!(scores.is_ok(), name == "partly", "{name}: {scores:?}");
        assert!(scores.is_ok_and(|scores| !scores.contains("earlier")) || name != "partly");
    }
}
