//! The launch files, run by the shipped binary: three processes, one process, lockstep.

use std::time::Duration;

use modulo_runtime::MessageKind;

use crate::harness::{Bench, Peer, arg, classes, json, model, text};

fn launch<'a>(file: &'a str, source: &'a str, model: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut arguments = vec!["launch", file, source, model, "alpha:=2", "engine:=rten"];
    arguments.extend(more);
    arguments
}

#[test]
fn three_processes_detect_on_every_frame_and_end_by_themselves() {
    let bench = Bench::new();
    let source = arg("source", bench.images(6));
    let model = arg("model", model());
    let summary = bench.path("summary.json");
    let file = summary.display().to_string();
    let output = bench.run(&launch("launch/recovered.launch.yaml", &source, &model, &["--summary", &file]));
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let summary = json(&summary);
    assert_eq!(summary["frames"], 6, "{summary}");
    assert_eq!(summary["topics"]["/recovered"]["in"], 6, "{summary}");
    assert_eq!(summary["topics"]["/detector/detections"]["out"], 6, "{summary}");
    assert_eq!(summary["engine"], "rten");
    assert!(summary["latency_ms"]["unwrap"]["p50"].as_f64().expect("measured") > 0.0);
    assert!(!classes(&summary, "recovered").is_empty(), "{summary}");
    assert!(text(&output).contains("p95 ms"), "the summary is shown");
}

#[test]
fn processes_one_process_and_lockstep_give_the_same_boxes() {
    let bench = Bench::new();
    let source = arg("source", bench.images(5));
    let model = arg("model", model());
    let mut found = Vec::new();
    for (name, more) in [("processes", vec![]), ("composed", vec!["--compose"])] {
        let file = bench.path(name);
        let file = file.to_str().expect("UTF-8");
        let more = [more, vec!["--summary", file]].concat();
        let output = bench.run(&launch("launch/raw.launch.yaml", &source, &model, &more));
        assert_eq!(output.status.code(), Some(0), "{name}: {}", text(&output));
        found.push(classes(&json(file.as_ref()), "modulo"));
    }
    let out = bench.path("lockstep");
    let output = bench.run(&[
        "eval",
        "launch/raw.launch.yaml",
        &source,
        &model,
        "alpha:=2",
        "engine:=rten",
        "-o",
        out.to_str().expect("UTF-8"),
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    found.push(classes(&json(&out.join("summary.json")), "modulo"));
    assert!(!found[0].is_empty());
    assert!(found.windows(2).all(|pair| pair[0] == pair[1]), "{found:?}");
}

#[test]
fn lockstep_writes_the_same_bytes_twice() {
    let bench = Bench::new();
    let source = arg("source", bench.images(4));
    let model = arg("model", model());
    // The noise is drawn from a seed, so it must not differ between the two runs either.
    let boxes = ["once", "twice"].map(|name| {
        let out = bench.path(name);
        let noise = ["read_noise:=5", "seed:=7", "engine:=rten"];
        let mut arguments = vec!["eval", "launch/compare.launch.yaml", &source, &model, "--images"];
        arguments.extend(noise);
        arguments.extend(["-o", out.to_str().expect("UTF-8")]);
        let output = bench.run(&arguments);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
        ["ideal.json", "recovered.json", "saturated.json", "modulo.json", "modulo/000003.png"]
            .map(|file| std::fs::read(out.join(file)).expect("written"))
    });
    assert_eq!(boxes[0], boxes[1]);
}

#[test]
fn compare_runs_a_detector_on_each_stream() {
    let bench = Bench::new();
    let source = arg("source", bench.images(3));
    let model = arg("model", model());
    let file = bench.path("summary.json");
    let summary = ["--compose", "--summary", file.to_str().expect("UTF-8")];
    let output = bench.run(&launch("launch/compare.launch.yaml", &source, &model, &summary));
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let summary = json(&file);
    for stream in ["modulo", "recovered", "saturated", "ideal"] {
        assert_eq!(
            summary["topics"][format!("/detector_{stream}/detections")]["out"],
            3,
            "{stream}: {summary}"
        );
    }
}

/// Two cameras in namespaces of their own are answered by their own detectors.
#[test]
fn each_camera_has_its_own_detector() {
    let bench = Bench::new();
    let images = bench.images(3);
    let [front, rear] = ["front", "rear"].map(|camera| arg(camera, &images));
    let model = arg("model", model());
    let file = ["launch", "launch/cameras.launch.yaml", "engine:=rten", "rate:=5.0", "loop:=true"];
    let running = bench.start(&[&file[..], &[&front, &rear, &model]].concat());
    let peer = Peer::new(&bench);
    let topics = ["/front/detector/detections", "/rear/detector/detections"];
    for (_heard, boxes) in topics.map(|topic| peer.listen(topic, MessageKind::Detections)) {
        boxes.recv_timeout(Duration::from_secs(60)).expect("boxes");
    }
    assert_eq!(running.interrupt(), Some(0));
}

/// Each is one line that names the thing, the value and what is allowed.
#[test]
fn bad_input_is_one_line_and_no_panic() {
    let bench = Bench::new();
    let images = bench.images(1);
    let source = arg("source", &images);
    let good_model = arg("model", model());
    let candidates = good_model.replace("rows", "candidates");
    // A picture that ends in the middle: the header promises more rows than there are.
    let truncated = bench.path("truncated");
    std::fs::create_dir_all(&truncated).expect("writable");
    let whole = std::fs::read(images.join("000000.png")).expect("readable");
    std::fs::write(truncated.join("000000.png"), &whole[..whole.len() / 2]).expect("writable");
    let truncated = arg("source", &truncated);
    let kitti = bench.path("kitti");
    std::fs::create_dir_all(kitti.join("image_2")).expect("writable");
    std::fs::create_dir_all(kitti.join("label_2")).expect("writable");
    std::fs::write(kitti.join("image_2/000000.png"), &whole).expect("writable");
    std::fs::write(kitti.join("label_2/000000.txt"), "Car 0.0 0\n").expect("writable");
    let kitti = arg("source", &kitti);
    let exr = bench.path("nan.exr");
    image::Rgb32FImage::from_pixel(4, 4, image::Rgb([f32::NAN; 3])).save(&exr).expect("writable");
    let exr = arg("source", &exr);
    let cut = bench.path("cut.jpg");
    image::RgbImage::new(64, 48).save(&cut).expect("writable");
    let whole = std::fs::read(&cut).expect("readable");
    std::fs::write(&cut, &whole[..whole.len() - 40]).expect("writable");
    let cut = arg("source", &cut);
    let deep = bench.path("deep.png");
    image::ImageBuffer::from_pixel(64, 48, image::Luma([4000_u16])).save(&deep).expect("writable");
    let deep = arg("source", &deep);

    let recovered = "launch/recovered.launch.yaml";
    let cases: [(&[&str], &[&str]); 13] = [
        (&[recovered, "source:=/no/such/folder", &good_model], &["/no/such/folder"]),
        (&[recovered, &truncated, &good_model], &["000000.png"]),
        (&[recovered, &kitti, &good_model], &["000000.txt", "3"]),
        (&[recovered, &exr, &good_model], &["nan.exr", "NaN"]),
        (&[recovered, &cut, &good_model], &["cut.jpg", "truncated"]),
        (&[recovered, &deep, &good_model], &["deep.png", "4000", "white", "4096"]),
        (&[recovered, &source, &good_model, "alpha:=0"], &["alpha", "0", "256"]),
        (&[recovered, &source, &good_model, "bits:=0"], &["bits", "0", "to 16"]),
        (&[recovered, &source, &good_model, "bits:=17"], &["bits", "17", "to 16"]),
        (&[recovered, &source, &candidates], &["candidates.onnx", "[1, N, 6]"]),
        (&[recovered, &source, &good_model, "colour:=red"], &["colour", "alpha"]),
        (&["/no/such.launch.yaml"], &["/no/such.launch.yaml"]),
        (
            &["launch/suite.launch.yaml", &source, &good_model, "input:=recoverd"],
            &["input", "recoverd", "saturated"],
        ),
    ];
    for (arguments, named) in cases {
        let output = bench.run(&[&["launch", "--compose"], arguments].concat());
        let said = text(&output);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{arguments:?}: {:?} {said}", output.status);
        let lines: Vec<_> = said.lines().filter(|line| line.starts_with("modulo: ")).collect();
        assert_eq!(lines.len(), 1, "{arguments:?}: {said}");
        for name in named {
            assert!(lines[0].contains(name), "{arguments:?} must name {name}: {}", lines[0]);
        }
        assert!(!said.contains("panicked"), "{said}");
    }
}

#[test]
fn an_unknown_launch_key_is_refused_with_its_line() {
    let bench = Bench::new();
    let file = bench.path("bad.launch.yaml");
    std::fs::write(&file, "launch:\n  - node:\n      pkg: modulo\n      exec: unwrap\n      paramz: []\n")
        .expect("writable");
    let output = bench.run(&["launch", file.to_str().expect("UTF-8")]);
    let said = text(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("bad.launch.yaml:5") && said.contains("paramz") && said.contains("param"),
        "{said}"
    );
}

/// A refusal in a child process reaches the user, and the run ends.
#[test]
fn a_refusing_node_ends_the_launch() {
    let bench = Bench::new();
    let source = arg("source", bench.images(1));
    let model = arg("model", "/no/such/model.onnx");
    let output = bench.run(&launch("launch/recovered.launch.yaml", &source, &model, &[]));
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert!(text(&output).contains("/no/such/model.onnx"));
}

#[test]
fn check_says_ok_or_every_mistake_with_its_line() {
    let bench = Bench::new();
    for file in ["raw", "recovered", "compare", "suite"] {
        let file = format!("launch/{file}.launch.yaml");
        let output = bench.run(&["launch", "--check", &file]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
        assert!(text(&output).starts_with(&format!("{file}: ok, ")), "{}", text(&output));
    }
    let file = bench.path("bad.launch.yaml");
    let bad =
        "launch:\n  - log: { message: \"$(var nope)\" }\n  - timer: { period: \"soon\", children: [] }\n";
    std::fs::write(&file, bad).expect("writable");
    let output = bench.run(&["launch", "--check", file.to_str().expect("UTF-8")]);
    let said = text(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("bad.launch.yaml:2: undefined variable 'nope'"), "{said}");
    assert!(said.contains("bad.launch.yaml:3: period = 'soon'") && said.contains("2 mistakes"), "{said}");
}

/// The declarations of the nodes are part of what a launch file can break.
#[test]
fn check_knows_the_parameters_of_the_suite() {
    let bench = Bench::new();
    let file = bench.path("bad.launch.yaml");
    let bad = "launch:\n  - node: { pkg: modulo, exec: unwarp }\n  - node:\n      pkg: modulo\n      exec: unwrap\n      \
               param: [{ name: alhpa, value: 2.0 }, { name: bits, value: 99 }]\n";
    std::fs::write(&file, bad).expect("writable");
    let output = bench.run(&["launch", "--check", file.to_str().expect("UTF-8")]);
    let said = text(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    for mistake in [
        "bad.launch.yaml:2: node 'unwarp' is unknown",
        "bad.launch.yaml:3: parameter 'alhpa' = 2.0: unknown parameter",
        "bad.launch.yaml:3: parameter 'bits' = 99: must be in 0 to 16",
    ] {
        assert!(said.contains(mistake), "{said}");
    }
}

#[test]
fn completions_and_manual_pages_name_the_commands() {
    let bench = Bench::new();
    let script = bench.run(&["completions", "bash"]);
    assert!(script.status.success() && text(&script).contains("modulo__subcmd__launch"), "{}", text(&script));
    let folder = bench.path("man1");
    let man = bench.run(&["man", folder.to_str().expect("UTF-8")]);
    assert!(man.status.success(), "{}", text(&man));
    let page = std::fs::read_to_string(folder.join("modulo-bag-record.1")).expect("a page for each command");
    assert!(page.contains("compression"), "{page}");
}
