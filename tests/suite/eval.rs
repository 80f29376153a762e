//! `modulo eval FILE`: every camera is scored, what cannot be evaluated is refused before anything is written, and what was evaluated is not
//! lost.

use std::path::Path;

use serde_json::Value;

use crate::harness::{Bench, assert_has, borrowed, in_shell, json, text, wait_until};

const RECOVERED: &str = "launch/recovered.launch.yaml engine:=rten";
/// Scenes of other sizes and lengths, whose labels differ.
const FRONT: &str = "scene://tunnel?seed=3&frames=3";
const REAR: &str = "scene://glare?seed=4&frames=2&width=256&height=160";

/// Runs `modulo eval` into the new folder `out` of the test.
fn eval(bench: &Bench, code: i32, line: &str) -> String {
    std::fs::remove_dir_all(bench.path("out")).ok();
    bench.says(code, &format!("eval {line} -o @/out"))
}

fn frames(file: &Path) -> usize {
    json(file).as_object().expect("frames").len()
}

#[test]
fn every_camera_is_scored_against_its_own_objects() {
    let bench = Bench::new();
    let alone = [FRONT, REAR].map(|source| {
        eval(&bench, 0, &format!("launch/suite.launch.yaml input:=metered engine:=rten source:={source}"));
        (bench.json("out/metered.json"), bench.json("out/scores.json")["metered"].clone())
    });
    assert!(alone.iter().all(|(_, score)| score["ap50"].as_f64() > Some(0.5)), "{alone:?}");
    for shared in ["shared:=false", "shared:=true"] {
        let out = bench.path(shared);
        let cameras = format!("engine:=rten front:={FRONT} rear:={REAR} {shared} --images");
        let message = bench.says(0, &format!("eval launch/cameras.launch.yaml {cameras} -o @/{shared}"));
        let scores = json(&out.join("scores.json"));
        for (name, (boxes, score)) in ["front.auto", "rear.auto"].iter().zip(&alone) {
            assert_eq!(&json(&out.join(format!("{name}.json"))), boxes, "{shared} {name}");
            assert_eq!(&scores[name], score, "{shared} {name}");
            let line = message.lines().any(|line| line.starts_with(&format!("AP50 on {name} ")));
            assert!(line, "{shared} {name}: {message}");
        }
        let images = ["000001.png", "000002.png"].map(|name| out.join("rear.auto").join(name).exists());
        assert_eq!(images, [true, false]);
        // Both, although they have other sizes and one ends first.
        let sheet = image::open(out.join("grid.png")).expect("an image");
        assert_eq!((sheet.width(), sheet.height()), (640 + 6 + 640, 24 + 192 + 24), "{shared}");
    }
}

#[test]
fn detectors_of_one_stream_have_files_of_their_own() {
    let bench = Bench::new();
    let detector = |name: &str, threshold: &str| {
        format!(
            "exec: detector, name: {name}, param: [{{ name: input, value: ideal }}, {{ name: engine, value: rten }}, \
             {{ name: score_threshold, value: {threshold} }}]"
        )
    };
    let camera =
        format!("exec: modulo_camera, name: camera, param: [{{ name: source, value: \"{FRONT}\" }}]");
    launch_file(&bench, "two.launch.yaml", &[&camera, &detector("low", "0.05"), &detector("high", "0.5")]);
    eval(&bench, 0, "@/two.launch.yaml");
    let [low, high] = ["low", "high"].map(|name| {
        let frames = bench.json(&format!("out/ideal.{name}.json"));
        let frames = frames.as_object().expect("frames");
        assert_eq!(frames.len(), 3, "{name}");
        frames.values().map(|boxes| boxes.as_array().expect("boxes").len()).sum::<usize>()
    });
    assert!(low > high && high > 0, "{low} {high}");
}

/// A launch file of these nodes.
fn launch_file(bench: &Bench, name: &str, nodes: &[&str]) {
    let node = |line: &&str| format!("  - node: {{ pkg: modulo, {line} }}\n");
    let lines: String = nodes.iter().map(node).collect();
    std::fs::write(bench.path(name), format!("launch:\n{lines}")).expect("writable");
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
    launch_file(&bench, "lone.yaml", &[camera, &foreign]);
    launch_file(&bench, "mixed.yaml", &[camera, &other, detector]);
    launch_file(&bench, "twins.yaml", &[camera, camera, detector]);
    std::fs::create_dir_all(bench.path("there")).expect("writable");
    std::fs::create_dir_all(bench.path("taken/recovered")).expect("writable");
    let cases: [(&str, &[&str]); 9] = [
        ("@/lone.yaml", &["/detector", "/elsewhere/image"]),
        ("@/mixed.yaml", &["/ideal", "/modulo_camera", "/other", "namespace"]),
        ("@/twins.yaml", &["/modulo_camera", "name"]),
        ("RECOVERED source:=SCENE loop:=true", &["/modulo_camera", "loop:=true", "frames:="]),
        ("RECOVERED source:=scene://day", &["scene://day", "no end", "frames:="]),
        ("RECOVERED source:=topic:/image", &["topic:/image", "modulo bag record"]),
        (
            "RECOVERED source:=SCENE --bag @/bag --topics modulo",
            &["--topics modulo", "/modulo", "/recovered"],
        ),
        ("RECOVERED --source SCENE --source /nope --bag @/bag --topics /modulo", &["/nope"]),
        ("RECOVERED source:=SCENE --bag @/there --topics /modulo", &["/there", "already there"]),
    ];
    let full = |line: &str| {
        line.replace("RECOVERED", RECOVERED).replace("SCENE", "scene://day?frames=2&width=96&height=64")
    };
    for (line, named) in cases {
        let message = eval(&bench, 2, &full(line));
        assert_eq!(message.lines().count(), 1, "{line}: {message}");
        assert_has(&message, named);
        assert!(!bench.path("out").exists() && !bench.path("bag").exists(), "{line} has left something");
    }
    let occupied = full("eval RECOVERED source:=SCENE -o @/taken --bag @/bag --topics /modulo");
    assert_has(&bench.says(2, &occupied), &["/taken", "not empty"]);
    assert!(!bench.path("bag").exists());
    // A loop with a number of frames has an end.
    let bag = "loop:=true frames:=4 --bag @/bag --topics /modulo";
    eval(&bench, 0, &format!("{RECOVERED} source:={FRONT} {bag}"));
    assert_eq!(frames(&bench.path("out/recovered.json")), 4);
}

/// The grid has the same kinds of sources and models.
#[test]
fn a_grid_without_an_end_or_a_model_is_refused() {
    let bench = Bench::new();
    for (line, named) in [
        (&*format!("--source {FRONT} --model /no.onnx"), "/no.onnx"),
        ("--source scene://day?width=96&height=64", "--source"),
        (&format!("--source {FRONT} --source scene://day"), "--source"),
    ] {
        assert_has(&eval(&bench, 2, line), &[named]);
        assert!(!bench.path("out").exists(), "{line}");
    }
}

#[test]
fn a_stopped_evaluation_keeps_the_frames_before() {
    let bench = Bench::new();
    let out = bench.path("out");
    let source = "source:=scene://day?seed=3&frames=100000&width=320&height=128 --images";
    let running = bench.starts(&format!("eval {RECOVERED} {source} -o @/out"));
    wait_until("two frames are there", || out.join("recovered/000001.png").is_file());
    assert_eq!(running.interrupt(), Some(3));
    let kept = frames(&out.join("recovered.json"));
    assert!((2..100_000).contains(&kept), "{kept}");
    assert_eq!(bench.json("out/summary.json")["stopped"], true);
    let score = &bench.json("out/scores.json")["recovered"];
    assert_eq!((&score["stopped"], score["frames"].as_u64()), (&Value::Bool(true), Some(kept as u64)));
}

/// The disk may be full at any time: the scores of all frames are printed, and the file is named.
#[test]
fn scores_are_printed_where_they_cannot_be_written() {
    let bench = Bench::new();
    let source = "source:=scene://day?seed=3&frames=3&width=320&height=128 --images";
    // In blocks of 512 bytes. What does not fit into one is lost; the scores fit into eight.
    for (blocks, lost) in [(1, &["summary.json", "report.html"][..]), (8, &["recovered/000000.png"])] {
        std::fs::remove_dir_all(bench.path("out")).ok();
        let words = bench.words(&format!("eval {RECOVERED} {source} -o @/out"));
        let full = format!("trap '' XFSZ; ulimit -f {blocks}");
        let output = in_shell(&bench.modulo(&borrowed(&words)), &full).output().expect("a shell");
        let (message, printed) = (text(&output), String::from_utf8_lossy(&output.stdout));
        assert_eq!(output.status.code(), Some(1), "{blocks}: {message}");
        assert_has(&printed, &["frames 3", "AP50 on recovered"]);
        assert_has(&message, lost);
        let left = std::fs::read_dir(bench.path("out")).expect("there").flatten();
        let cut = left.filter(|entry| entry.file_name().to_string_lossy().starts_with('.'));
        assert_eq!(cut.count(), 0, "no half of a file stays");
    }
    assert_eq!(bench.json("out/scores.json")["recovered"]["frames"], 3, "the others are written");
}

#[test]
fn a_bad_source_keeps_the_results_of_those_before_it() {
    let bench = Bench::new();
    std::fs::create_dir_all(bench.path("bad")).expect("writable");
    // A loop without a good frame cannot go on.
    std::fs::write(bench.path("bad/000000.png"), "no image").expect("writable");
    let looped = format!("{RECOVERED} loop:=true frames:=3");
    let message = eval(&bench, 1, &format!("{looped} --source {FRONT} --source @/bad"));
    assert_has(&message, &["AP50 on recovered", "000000.png"]);
    assert_eq!(bench.json("out/scores.json")["recovered"]["frames"], 3);
    bench.says(1, &format!("eval {looped} --source @/bad --topics /modulo --bag @/bag -o @/none"));
    assert!(!bench.path("bag").exists(), "no frame came before the fault");
}

/// The folder `kitti` with two images and a label of `classes` for each of the first ones.
fn kitti(bench: &Bench, classes: &[&str]) {
    let folder = bench.path("kitti");
    std::fs::remove_dir_all(&folder).ok();
    std::fs::create_dir_all(folder.join("label_2")).expect("writable");
    std::fs::rename(bench.images(2), folder.join("image_2")).expect("moved");
    for (number, class) in classes.iter().enumerate() {
        let label = format!("{class} 0.00 0 0.0 10 10 60 60 -1 -1 -1 -1000 -1000 -1000 -10\n");
        std::fs::write(folder.join(format!("label_2/{number:06}.txt")), label).expect("writable");
    }
}

#[test]
fn a_stream_without_a_score_says_why() {
    let bench = Bench::new();
    let scores = bench.path("out/scores.json");
    let cases: [(&[&str], i32, &str); 3] = [
        (&[], 0, "none, no frame has labels"),
        (&["DontCare", "DontCare"], 3, "none, there is no labelled object"),
        (&["Car"], 3, "1 other frames have no labels"),
    ];
    for (classes, code, expected) in cases {
        kitti(&bench, classes);
        assert_has(&eval(&bench, code, &format!("{RECOVERED} source:=@/kitti model:=%")), &[expected]);
        let page = std::fs::read_to_string(bench.path("out/report.html")).expect("a report");
        assert_has(&page, &[expected.trim_start_matches("none, "), "<img src=\"grid.png\""]);
        assert_eq!(scores.exists(), classes == ["Car"], "{classes:?}");
    }
}

/// `modulo detect` writes a picture with boxes for each frame, and prints a line with its objects.
#[test]
fn pictures_are_written_with_their_boxes() {
    let bench = Bench::new();
    let message =
        bench.says(0, "detect scene://day?seed=1&frames=2&width=640&height=192 -o @/out engine:=rten");
    assert_has(&message, &["out/000001.png: ", "out/000002.png: ", " car"]);
    let shown = |name: &str| image::open(bench.path(name)).expect("a picture").into_rgb8();
    assert_eq!(shown("out/000001.png").dimensions(), (640, 192));
    let message = bench.says(
        0,
        "detect scene://day?seed=1&frames=2&width=640&height=192 -o @/none engine:=rten score_threshold:=1.0",
    );
    assert_has(&message, &["none/000002.png: no object"]);
    assert_ne!(shown("out/000001.png"), shown("none/000001.png"), "boxes are drawn");
    assert_has(&bench.says(2, "detect /no/such.png -o @/no"), &["/no/such.png"]);
    assert_has(
        &bench.says(2, "detect scene://day?frames=1 --model /no.onnx -o @/no"),
        &["/no.onnx", "No such file"],
    );
    assert!(!bench.path("no").exists());
}

/// A shell leaves `~` as it is behind `:=` and `=`.
#[test]
fn a_tilde_is_the_home_folder_wherever_a_path_is_given() {
    let bench = Bench::new();
    bench.images(1);
    let at_home = |code, line: &str, wanted: &str| {
        let mut command = bench.modulo(&borrowed(&bench.words(line)));
        let output = command.env("HOME", bench.folder.path()).output().expect("the binary starts");
        let message = text(&output);
        assert_eq!(output.status.code(), Some(code), "{line}\n{message}");
        assert_has(&message, &[wanted]);
    };
    let folder = bench.folder.path().display().to_string();
    let gone = |name: &str| format!("{folder}/{name}");
    at_home(
        0,
        "eval launch/raw.launch.yaml engine:=rten source:=~/images -o=~/out",
        &gone("out/report.html"),
    );
    at_home(2, "eval launch/raw.launch.yaml source:=~/images model:=~/gone.onnx -o @/no", &gone("gone.onnx"));
    at_home(2, "eval launch/raw.launch.yaml source:=~/gone.mp4 -o @/no", &gone("gone.mp4"));
    at_home(2, "eval launch/raw.launch.yaml source:=video:~/gone.dat -o @/no", &gone("gone.dat"));
    at_home(2, "eval --yolo=~/gone -o @/no", &gone("gone"));
    at_home(2, "model check ~/gone.onnx", &gone("gone.onnx"));
    at_home(2, "bag info ~/gone", &gone("gone"));
    // The home folder of another user, and a name that begins so.
    at_home(2, "bag info ~other/gone", "~other/gone");
    at_home(2, "bag info ./~/gone", "./~/gone");
}
