//! `modulo eval FILE`: every camera is scored, what cannot be evaluated is refused before anything is written, and what was evaluated is not
//! lost.

use std::path::Path;

use serde_json::Value;

use crate::harness::{Bench, assert_has, borrowed, cell, evaluated, in_shell, text, wait_until};

const RECOVERED: &str = "launch/recovered.launch.yaml engine:=rten";
/// Scenes of other sizes and lengths, whose labels differ.
const FRONT: &str = "scene://tunnel?seed=3&frames=3";
const REAR: &str = "scene://glare?seed=4&frames=2&width=256&height=160";

/// Runs `modulo eval` into the new folder `out` of the test.
fn eval(bench: &Bench, code: i32, line: &str) -> String {
    std::fs::remove_dir_all(bench.path("out")).ok();
    bench.says(code, &format!("eval {line} -o @/out"))
}

/// The figures of a cell that do not depend on its name.
fn figures(folder: &Path, stream: &str) -> Vec<Value> {
    let cell = cell(folder, stream);
    ["ap50", "objects", "interval95", "exact_k", "frames", "psnr_db"].map(|name| cell[name].clone()).into()
}

#[test]
fn every_camera_is_scored_against_its_own_objects() {
    let bench = Bench::new();
    let out = bench.path("out");
    let alone = [FRONT, REAR].map(|source| {
        eval(&bench, 0, &format!("launch/suite.launch.yaml input:=metered engine:=rten source:={source}"));
        (evaluated(&out, "metered"), figures(&out, "metered"))
    });
    for shared in ["shared:=false", "shared:=true"] {
        let out = bench.path(shared);
        let cameras = format!("engine:=rten front:={FRONT} rear:={REAR} {shared} --images");
        bench.says(0, &format!("eval launch/cameras.launch.yaml {cameras} -o @/{shared}"));
        for (name, (boxes, figures_alone)) in ["front.auto", "rear.auto"].iter().zip(&alone) {
            assert_eq!(&evaluated(&out, name), boxes, "{shared} {name}");
            assert_eq!(&figures(&out, name), figures_alone, "{shared} {name}");
        }
        let images = ["000001.png", "000002.png"].map(|name| out.join("rear.auto").join(name).exists());
        assert_eq!(images, [true, false]);
        assert!(out.join("grid.png").is_file());
    }
}

/// Arguments and parameters vary, and equal cells are there once; another run on the folder adds to it.
#[test]
fn what_varies_gives_cells_of_its_own() {
    let bench = Bench::new();
    let varied = "--vary alpha=2,4 --vary unwrap.method=auto,spud";
    let line =
        format!("eval launch/compare.launch.yaml engine:=rten source:={FRONT} --stream ideal,recovered");
    bench.says(0, &format!("{line} {varied} -o @/out"));
    let cells = || bench.json("out/results.json")["cells"].as_array().expect("cells").clone();
    let words = |cell: &Value| (cell["alpha"].clone(), cell["stream"].clone(), cell["method"].clone());
    let named: Vec<_> = cells().iter().map(words).collect();
    let expected = [2.0, 4.0].map(|alpha: f64| {
        [("ideal", Value::Null), ("recovered", "auto".into()), ("recovered", "spud".into())]
            .map(|(stream, method)| (Value::from(alpha), Value::from(stream), method))
    });
    assert_eq!(named, expected.concat());
    let before = cells();
    bench.says(0, &format!("{line} --alpha 4,8 --method auto -o @/out"));
    let after = cells();
    assert_eq!((after.len(), &after[..6]), (8, &before[..]));
    for (more, named) in [
        ("--vary nobody.alpha=2", &["nobody.alpha", "detector_ideal"][..]),
        ("--vary alhpa=2", &["alhpa", "alpha"]),
        ("--vary alpha", &["NAME=VALUE"]),
        ("--stream depth", &["depth", "recovered"]),
        ("--vary unwrap.method=magic", &["magic", "spud"]),
        ("--frames 5:2", &["FIRST:END"]),
    ] {
        assert_has(&bench.says(2, &format!("{line} {more} -o @/none")), named);
        assert!(!bench.path("none").exists(), "{more}");
    }
    assert_has(&bench.says(2, &format!("{line} --frames 3:9 -o @/none")), &["no frame from number 3 on"]);
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
    // All boxes are kept: a threshold is a matter of those who read them.
    let [low, high] = ["low", "high"].map(|name| evaluated(&bench.path("out"), &format!("ideal.{name}")));
    assert_eq!((low.len(), low == high), (3, true));
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
    assert_eq!(evaluated(&bench.path("out"), "recovered").len(), 4);
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
    let line = format!(
        "eval {RECOVERED} model:=% source:=scene://day?seed=3&frames=100000&width=96&height=64 -o @/out"
    );
    let running = bench.starts(&line);
    // The first slice is whole, and the second one has begun.
    wait_until("a second slice is there", || {
        out.join("frames").is_dir() && std::fs::read_dir(out.join("frames")).expect("there").count() > 1
    });
    assert_eq!(running.interrupt(), Some(3));
    let kept = evaluated(&out, "recovered").len();
    assert!((100..100_000).contains(&kept), "{kept}");
    assert_eq!(cell(&out, "recovered")["frames"], kept);
}

/// The disk may be full at any time: the file is named, and no half of one stays.
#[test]
fn a_file_that_cannot_be_written_is_named() {
    let bench = Bench::new();
    let source = "source:=scene://day?seed=3&frames=3&width=320&height=128";
    // In blocks of 512 bytes. The plan fits into two and the labels do not; these fit into eight, and the boxes do not.
    for (blocks, lost) in [(2, "out/frames/"), (8, "out/cells/")] {
        std::fs::remove_dir_all(bench.path("out")).ok();
        let words = bench.words(&format!("eval {RECOVERED} {source} -o @/out"));
        let full = format!("trap '' XFSZ; ulimit -f {blocks}");
        let output = in_shell(&bench.modulo(&borrowed(&words)), &full).output().expect("a shell");
        let message = text(&output);
        assert_eq!(output.status.code(), Some(1), "{blocks}: {message}");
        assert_has(&message, &[lost]);
        for folder in ["out", "out/frames", "out/cells"] {
            let left = std::fs::read_dir(bench.path(folder)).into_iter().flatten().flatten();
            let cut = left.filter(|entry| entry.file_name().to_string_lossy().starts_with(".modulo"));
            assert_eq!(cut.count(), 0, "no half of a file stays");
        }
    }
}

#[test]
fn a_bad_source_keeps_the_results_of_those_before_it() {
    let bench = Bench::new();
    std::fs::create_dir_all(bench.path("bad")).expect("writable");
    std::fs::write(bench.path("bad/000000.png"), "no image").expect("writable");
    let message = eval(&bench, 3, &format!("{RECOVERED} --source {FRONT} --source @/bad"));
    assert_has(&message, &["AP50 ", "000000.png", "1 frames are not readable"]);
    assert_eq!(cell(&bench.path("out"), "recovered")["frames"], 3);
    // A loop without a good frame has no end.
    assert_has(&eval(&bench, 1, &format!("{RECOVERED} loop:=true frames:=3 source:=@/bad")), &["000000.png"]);
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
    let cases: [(&[&str], i32, &str); 3] = [
        (&[], 0, "no frame has labels"),
        (&["DontCare", "DontCare"], 3, "no labelled object is scored"),
        (&["Car"], 3, "1 frames have no labels"),
    ];
    for (classes, code, expected) in cases {
        kitti(&bench, classes);
        assert_has(&eval(&bench, code, &format!("{RECOVERED} source:=@/kitti model:=%")), &[expected]);
        let page = std::fs::read_to_string(bench.path("out/report.html")).expect("a report");
        assert_has(&page, &["data:image/jpeg;base64,"]);
        let ap50 = &cell(&bench.path("out"), "recovered")["ap50"]["vehicle"];
        assert_eq!(ap50.is_null(), classes != ["Car"], "{classes:?}: {ap50}");
    }
}

/// Most drives of users have no labels.
#[test]
fn without_labels_the_boxes_of_the_ideal_image_are_the_reference() {
    let bench = Bench::new();
    kitti(&bench, &[]);
    let said = eval(&bench, 0, "launch/compare.launch.yaml engine:=rten source:=@/kitti model:=%");
    assert_has(
        &said,
        &["No frame has labels: the reference is", "(ideal). ", "finds more objects than saturated"],
    );
    assert!(!said.contains("ideal has the highest"), "the reference is compared with itself: {said}");
    let ideal = &cell(&bench.path("out"), "ideal")["ap50"];
    let groups = ideal.as_object().expect("groups");
    let is_all = !groups.is_empty() && groups.values().all(|ap50| *ap50 == 1.0);
    assert!(is_all, "what ideal has found is not the reference: {ideal}");
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
