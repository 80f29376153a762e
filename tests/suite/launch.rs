//! The launch files, run by the shipped binary: three processes, one process, lockstep. Recorded frames: the sample bag that comes with
//! the project, and real frames where the shared test data is at hand.

use std::path::{Path, PathBuf};
use std::time::Duration;

use modulo_bags::bag::{BagReader, BagTopic, BagWriter, Compression, Selection};
use modulo_runtime::MessageKind;
use serde_json::Value;

use crate::harness::{Bench, Peer, arg, classes, data, json, model, text};

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

/// A sensor file replaces arguments in processes and in one process, and the commands that measure read the same file.
#[test]
fn a_sensor_file_describes_the_sensor_everywhere() {
    let bench = Bench::new();
    let paths = [bench.images(2), bench.path("out"), bench.path("grid"), bench.path("summary.json")];
    let [images, out, grid_out, summary] = paths.map(|path| path.display().to_string());
    let (source, model) = (format!("source:={images}"), arg("model", model()));
    for more in [&[][..], &["--compose"]] {
        let more = [&["sensor:=sensors/two_gains.yaml", "gains:=none", "--summary", &summary], more].concat();
        let output = bench.run(&launch("launch/recovered.launch.yaml", &source, &model, &more));
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
        assert!(text(&output).contains("/unwrap used checkerboard_gains 2"), "{more:?}: {}", text(&output));
    }
    let sensor = ["--sensor", "sensors/two_gains.yaml", "--alpha", "2", "-o"];
    let measured =
        bench.run(&[&["simulate", &format!("{images}/000000.png")], &sensor[..], &[&out]].concat());
    assert_eq!(measured.status.code(), Some(0), "{}", text(&measured));
    let row = &json(&bench.path("out/results.json"))[0];
    assert_eq!((&row["gains"], &row["psf_sigma"]), (&"checkerboard".into(), &0.0.into()), "{row}");
    let scene = "scene://day?frames=1&width=320&height=192";
    let grid = ["eval", "--source", scene, "--stream", "recovered", "--engine", "rten", "--time-frames", "0"];
    let measured = bench.run(&[&grid, &sensor[..], &[&grid_out]].concat());
    assert_eq!(measured.status.code(), Some(0), "{}", text(&measured));
    let cell = &json(&bench.path("grid/results.json"))["cells"][0];
    let words = ["gains", "mosaic"].map(|name| cell[name].as_str().expect("a word"));
    assert_eq!(words, ["checkerboard", "none"], "{cell}");
    let figures = ["psf_sigma", "read_noise", "full_well_electrons", "prnu", "hot_pixels"];
    let figures = figures.map(|name| cell[name].as_f64().expect("a number"));
    assert_eq!(figures, [0.0, 0.06, 10_000.0, 0.005, 1e-5], "{cell}");
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

/// Two cameras in namespaces of their own are answered by their own detectors, or by one that they share.
#[test]
fn each_camera_is_answered_on_a_topic_of_its_own() {
    for (shared, topics) in [
        ("shared:=false", ["/front/detector/detections", "/rear/detector/detections"]),
        ("shared:=true", ["/detector/front/detections", "/detector/rear/detections"]),
    ] {
        let bench = Bench::new();
        let images = bench.images(3);
        let [front, rear] = ["front", "rear"].map(|camera| arg(camera, &images));
        let model = arg("model", model());
        let file =
            ["launch", "launch/cameras.launch.yaml", "engine:=rten", "rate:=5.0", "loop:=true", shared];
        let running = bench.start(&[&file[..], &[&front, &rear, &model]].concat());
        let peer = Peer::new(&bench);
        for (_heard, boxes) in topics.map(|topic| peer.listen(topic, MessageKind::Detections)) {
            boxes.recv_timeout(Duration::from_secs(60)).expect("boxes");
        }
        assert_eq!(running.interrupt(), Some(0), "{shared}");
    }
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
        let complaint = text(&output);
        assert!(
            matches!(output.status.code(), Some(1 | 2)),
            "{arguments:?}: {:?} {complaint}",
            output.status
        );
        let lines: Vec<_> = complaint.lines().filter(|line| line.starts_with("modulo: ")).collect();
        assert_eq!(lines.len(), 1, "{arguments:?}: {complaint}");
        for name in named {
            assert!(lines[0].contains(name), "{arguments:?} must name {name}: {}", lines[0]);
        }
        assert!(!complaint.contains("panicked"), "{complaint}");
    }
}

/// A command whose results cannot be written runs nothing.
#[test]
fn an_output_that_cannot_be_written_is_refused_before_the_run() {
    let bench = Bench::new();
    let images = bench.images(1).display().to_string();
    let kitti = bench.path("kitti");
    std::fs::create_dir_all(kitti.join("image_2")).expect("writable");
    std::fs::copy(bench.path("images/000000.png"), kitti.join("image_2/000000.png")).expect("copied");
    let (kitti, image) = (kitti.display().to_string(), format!("{images}/000000.png"));
    // Root can write nearly everywhere, but nobody can below a file.
    let out = format!("{image}/out");
    let (source, model) = (format!("source:={images}"), arg("model", model()));
    let recovered = ["launch", "launch/recovered.launch.yaml", &source, &model];
    let cases: [&[&str]; 12] = [
        &[&recovered[..], &["--summary", &out]].concat(),
        &[&recovered[..], &["--summary", "/no/dir/s.json"]].concat(),
        &[&recovered[..], &["--summary", &images]].concat(),
        &[&recovered[..], &["--compose", "--summary", &out]].concat(),
        &[&recovered[..], &["--trace", &out]].concat(),
        &["bag", "record", "-o", &out],
        &["bag", "import", "kitti", &kitti, &out],
        &["bag", "convert", "bags/samples/tunnel", &out],
        &["simulate", &image, "-o", &out],
        &["unwrap", &image, "--alpha", "4", "-o", &out],
        &["bench", "detector", "--kitti", &kitti, "-o", &out],
        &["stability", "-o", &out],
    ];
    for words in cases {
        let output = bench.run(words);
        let complaint = text(&output);
        assert_eq!(output.status.code(), Some(2), "{words:?}: {complaint}");
        let lines: Vec<_> = complaint.lines().collect();
        assert_eq!(lines.len(), 1, "{words:?} has run something: {complaint}");
        let path = words.iter().position(|word| ["-o", "--summary", "--trace"].contains(word));
        let path = path.map_or(out.as_str(), |option| words[option + 1]);
        assert!(lines[0].contains(path) && lines[0].contains("written"), "{words:?}: {complaint}");
        assert_eq!(complaint.matches("os error").count(), 1, "{words:?} tells its cause once: {complaint}");
    }
}

/// The disk may be full when the run is over: what was counted is printed first.
#[test]
fn a_summary_that_cannot_be_written_at_the_end_is_printed() {
    let bench = Bench::new();
    let (source, model) = (arg("source", bench.images(2)), arg("model", model()));
    for option in ["--summary", "--trace"] {
        let arguments = launch("launch/recovered.launch.yaml", &source, &model, &[option, "/dev/full"]);
        let output = bench.run(&arguments);
        let complaint = text(&output);
        assert_eq!(output.status.code(), Some(1), "{complaint}");
        let summary = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(summary.contains("2 frames") && complaint.contains("/dev/full"), "{option}: {complaint}");
    }
}

#[test]
fn an_unknown_launch_key_is_refused_with_its_line() {
    let bench = Bench::new();
    let file = bench.path("bad.launch.yaml");
    std::fs::write(&file, "launch:\n  - node:\n      pkg: modulo\n      exec: unwrap\n      paramz: []\n")
        .expect("writable");
    let output = bench.run(&["launch", file.to_str().expect("UTF-8")]);
    let complaint = text(&output);
    assert_eq!(output.status.code(), Some(2), "{complaint}");
    assert!(
        complaint.contains("bad.launch.yaml:5")
            && complaint.contains("paramz")
            && complaint.contains("param"),
        "{complaint}"
    );
}

/// A refusal in a child process reaches the user, and the run ends.
#[test]
fn a_refusing_node_ends_the_launch() {
    let bench = Bench::new();
    let source = arg("source", bench.images(1));
    let model = arg("model", "/no/such/model.onnx");
    let output = bench.run(&launch("launch/recovered.launch.yaml", &source, &model, &[]));
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
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
    let bad = "launch:\n  - log: { message: \"$(var nope)\" }\n  - log: { message: a, if: \"soon\" }\n";
    std::fs::write(&file, bad).expect("writable");
    let output = bench.run(&["launch", "--check", file.to_str().expect("UTF-8")]);
    let complaint = text(&output);
    assert_eq!(output.status.code(), Some(1), "{complaint}");
    assert!(complaint.contains("bad.launch.yaml:2: undefined variable 'nope'"), "{complaint}");
    assert!(
        complaint.contains("bad.launch.yaml:3: if: 'soon'") && complaint.contains("2 errors"),
        "{complaint}"
    );
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
    let complaint = text(&output);
    assert_eq!(output.status.code(), Some(1), "{complaint}");
    for mistake in [
        "bad.launch.yaml:2: node 'unwarp' is unknown",
        "bad.launch.yaml:3: parameter 'alhpa' = 2.0: unknown parameter",
        "bad.launch.yaml:3: parameter 'bits' = 99: must be in 0 to 16",
    ] {
        assert!(complaint.contains(mistake), "{complaint}");
    }
}

/// Parameters for all nodes of a stack are no mistakes of its launch file, those written at a node of the suite are.
#[test]
fn check_tells_parameters_of_other_nodes_from_misspelt_ones() {
    let bench = Bench::new();
    let (file, parameters) = (bench.path("stack.launch.yaml"), bench.path("stack.yaml"));
    let check = |stack: &str, own: &str| {
        std::fs::write(&parameters, format!("{stack}\n")).expect("writable");
        let from = parameters.display();
        let text = format!(
            "launch:\n  - set_parameter: {{ name: wheel_radius, value: \"0.383\" }}\n  - node:\n      pkg: modulo\n      \
             exec: unwrap\n      param: [{{ from: \"{from}\" }}{own}]\n"
        );
        std::fs::write(&file, text).expect("writable");
        bench.run(&["launch", "--check", file.to_str().expect("UTF-8")])
    };
    let fine = check("/**: {ros__parameters: {robot_base_frame: base_link}}", "");
    assert_eq!(fine.status.code(), Some(0), "{}", text(&fine));
    for (stack, own, named) in [
        ("/unwrap: {ros__parameters: {robot_base_frame: a}}", "", "robot_base_frame"),
        ("/**: {ros__parameters: {psf_sgima: 1.0}}", "", "did you mean 'psf_sigma'?"),
        ("/**: {ros__parameters: {}}", ", { name: wheel_radius, value: 0.4 }", "wheel_radius"),
        ("/**: {ros__parameters: {bits: 99}}", "", "must be in 0 to 16"),
    ] {
        let refused = check(stack, own);
        assert_eq!(refused.status.code(), Some(1), "{stack}{own}: {}", text(&refused));
        assert!(text(&refused).contains(named), "{stack}{own}: {}", text(&refused));
    }
    let launched = bench.run(&["launch", file.to_str().expect("UTF-8")]);
    assert_eq!(launched.status.code(), Some(2), "{}", text(&launched));
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

#[test]
fn the_pipeline_is_measured_in_every_mode() {
    let bench = Bench::new();
    let (out, model) = (bench.path("out"), model());
    let folder = out.display().to_string();
    let frames = "scene://tunnel?seed=3&width=160&height=64";
    // At rate 0 no frame is replaced, however slow the machine is.
    let fixed = ["bench", "pipeline", "--frames", frames, "--engine", "rten", "--count", "12", "--rate", "0"];
    let output = bench.run(&[&fixed[..], &["--model", &model, "-o", &folder]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let rows = json(&out.join("results.json"));
    for (row, mode) in ["lockstep", "composed", "live"].into_iter().enumerate() {
        let row = &rows[row];
        assert_eq!((&row["mode"], &row["engine"]), (&mode.into(), &"rten".into()), "{rows}");
        let number = |name: &str| row[name].as_f64().unwrap_or_else(|| panic!("{name} in {rows}"));
        assert!(0.0 < number("p50_ms") && number("p50_ms") <= number("p99_ms"), "{rows}");
        let infer = row["stage_ms"]["detector infer"].as_f64().expect("the stage of the network");
        assert!(0.0 < infer && infer <= number("p99_ms"), "{rows}");
        for name in ["bare_p50_ms", "cpu_s_per_frame", "rss_mb", "frames"] {
            assert!(number(name) > 0.0, "{name} in {rows}");
        }
    }
}

/// The second model answers in no time, and finds nothing.
#[test]
fn the_fastest_engine_is_named_among_those_that_are_accurate() {
    let bench = Bench::new();
    let (out, fast) = (bench.path("out"), model());
    let folder = out.display().to_string();
    let source = "scene://day?seed=3&frames=20&width=320&height=128";
    let models = format!("demo,{fast}");
    let output = bench
        .run(&["bench", "detector", "--source", source, "--model", &models, "--count", "25", "-o", &folder]);
    let complaint = text(&output);
    assert_eq!(output.status.code(), Some(0), "{complaint}");
    let rows = json(&out.join("results.json"));
    let row = |engine: &str, device: &str, model: &str| {
        let fits = |row: &&Value| row["engine"] == engine && row["device"] == device && row["model"] == model;
        rows.as_array().and_then(|rows| rows.iter().find(fits)).expect("a row")
    };
    let number = |row: &Value, name: &str| row["measured"][name].as_f64().expect(name);
    let (right, wrong) = (row("rten", "cpu", "demo"), row("rten", "cpu", &fast));
    for measured in [right, wrong] {
        assert!(0.0 < number(measured, "p50_ms") && number(measured, "p50_ms") <= number(measured, "p99_ms"));
        assert_eq!((number(measured, "frames"), number(measured, "inferences")), (20.0, 25.0));
        assert!(number(measured, "rss_mb") > 10.0, "{measured}");
    }
    let vehicle = right["measured"]["ap50"]["vehicle"].as_f64().expect("vehicles");
    let bounds = &right["measured"]["interval95"]["vehicle"];
    assert!(
        vehicle > 0.5 && bounds[0].as_f64() <= Some(vehicle) && bounds[1].as_f64() >= Some(vehicle),
        "{right}"
    );
    assert!(number(right, "loss").abs() < 0.005 && number(wrong, "loss") > 0.5, "{rows}");
    assert!(number(wrong, "p50_ms") < number(right, "p50_ms"), "{rows}");
    let missing = row("ort", "cuda", "demo")["missing"].as_str().expect("no GPU where the tests run");
    assert!(missing.contains("engine 'ort'") || missing.contains("cuda:0"), "{missing}");
    assert!(out.join("engines.png").exists());
    assert!(
        complaint.lines().any(|line| line.contains("engine:=") && line.ends_with("model:=demo")),
        "{complaint}"
    );
}

#[test]
fn engines_are_not_judged_by_few_frames() {
    let bench = Bench::new();
    bench.images(2);
    let kitti = bench.path("kitti");
    std::fs::create_dir_all(kitti.join("label_2")).expect("writable");
    std::fs::rename(bench.path("images"), kitti.join("image_2")).expect("writable");
    for frame in ["000000", "000001"] {
        let label = "Car 0.00 0 0.0 10 20 60 60 -1 -1 -1 -1000 -1000 -1000 -10\n";
        std::fs::write(kitti.join(format!("label_2/{frame}.txt")), label).expect("writable");
    }
    let (kitti, out) = (kitti.display().to_string(), bench.path("out").display().to_string());
    let output = bench.run(&["bench", "detector", "--kitti", &kitti, "--count", "1", "-o", &out]);
    let complaint = text(&output);
    assert_eq!(output.status.code(), Some(2), "{complaint}");
    assert!(complaint.contains("labelled frames is 2") && complaint.contains("at least 20"), "{complaint}");
}

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
fn a_camera_with_two_gains_tells_unwrap_of_them() {
    let bench = Bench::new();
    let out = bench.path("out");
    let arguments =
        ["source:=scene://tunnel?seed=3&frames=2", "psf_sigma:=0.0", "gains:=checkerboard", "engine:=rten"];
    let words =
        [&["eval", "launch/recovered.launch.yaml"][..], &arguments, &["-o", out.to_str().expect("UTF-8")]];
    let output = bench.run(&words.concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert!(text(&output).contains("/unwrap used checkerboard_gains 2"), "{}", text(&output));
}

#[test]
fn a_mosaic_is_recovered_by_the_suite() {
    let bench = Bench::new();
    let out = bench.path("out");
    let arguments =
        ["source:=scene://tunnel?seed=3&frames=2", "psf_sigma:=1.4", "alpha:=2.0", "mosaic:=grbg"];
    let places = ["engine:=rten", "-o", out.to_str().expect("UTF-8")];
    let words = [&["eval", "launch/recovered.launch.yaml"][..], &arguments, &places].concat();
    let output = bench.run(&words);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert!(text(&output).contains("trusted 2 of 2"), "{}", text(&output));
}

/// The sample as the bag of two cameras, one of which has a name that ROS 2 does not allow.
fn two_cameras(path: &Path) {
    let sample = BagReader::open(&sample()).expect("a bag");
    let mut bag = BagWriter::create(path, Compression::None).expect("a new bag");
    for message in sample.messages(&Selection::of(["/modulo", "/sensor_info"])) {
        let message = message.expect("readable");
        for camera in ["/front", "/rear cam"] {
            let topic =
                BagTopic { name: format!("{camera}{}", message.topic.name), ..(*message.topic).clone() };
            let id = bag.topic(&topic).expect("one type");
            bag.write(id, message.log_time, message.publish_time, &message.data).expect("writable");
        }
    }
    bag.finish().expect("writable");
}

#[test]
fn the_sample_replayed_shows_traffic() {
    let bench = Bench::new();
    let two = bench.path("two");
    two_cameras(&two);
    let of_rear = ["bag_topic:=/rear cam/modulo", "bag_sensor_info:=/rear cam/sensor_info"];
    for (bag, topics) in [(sample(), &[][..]), (two, &of_rear)] {
        let (bag, summary) = (arg("bag", bag), bench.path("summary.json"));
        let file = summary.display().to_string();
        let arguments =
            ["launch", "launch/replay.launch.yaml", &bag, "play_rate:=0", "engine:=rten", "--summary", &file];
        let output = bench.run(&[&arguments, topics].concat());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
        assert!(!text(&output).contains("DURABILITY"), "{}", text(&output));
        let summary = json(&summary);
        assert_eq!(summary["frames"], 12, "{summary}");
        // At rate 0 the player waits for the nodes, so that a busy machine replaces no frame.
        let count = |topic: &str, field: &str| summary["topics"][topic][field].as_u64().expect("a count");
        assert_eq!(count("/detector/detections", "out"), 12, "{summary}");
        assert_eq!(count("/modulo", "dropped") + count("/recovered", "dropped"), 0, "{summary}");
        assert!(classes(&summary, "recovered")["car"] >= 30, "{summary}");
    }
}

#[test]
fn a_bag_with_several_cameras_is_a_source_by_the_name_of_a_topic() {
    let bench = Bench::new();
    let (two, out) = (bench.path("two"), bench.path("out"));
    two_cameras(&two);
    let (source, front) = (arg("source", &two), arg("front", &two));
    let out = ["engine:=rten", "-o", out.to_str().expect("UTF-8")];
    let eval = |arguments: &[&str]| {
        bench.run(&[&["eval", "launch/raw.launch.yaml", &source], arguments, &out].concat())
    };
    let refused = eval(&[]);
    let complaint = text(&refused);
    assert_eq!(refused.status.code(), Some(2), "{complaint}");
    assert!(
        complaint.contains("2 image topics") && complaint.contains("'source_topic:=/front/modulo'"),
        "{complaint}"
    );
    let done = eval(&["source_topic:=/rear cam/modulo"]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done));
    assert!(text(&done).contains("frames 12"), "{}", text(&done));

    let (rear, topics) = (arg("rear", &two), ["front_topic:=/front/modulo", "rear_topic:=/rear cam/modulo"]);
    let print = ["launch", "--print", "launch/cameras.launch.yaml", &front, &rear];
    let printed = text(&bench.run(&[&print, &topics[..]].concat()));
    for topic in ["/front/modulo", "'/rear cam/modulo'"] {
        assert!(printed.contains(&format!("source_topic = {topic}")), "{topic} in {printed}");
    }
}

/// A bag that was cut, and one with a chunk that fails its CRC: each command answers what is there, names what is not, and ends with 3.
#[test]
fn a_damaged_bag_ends_each_command_with_3() {
    let bench = Bench::new();
    let whole = std::fs::read(sample().join("tunnel_0.mcap")).expect("readable");
    let mut flipped = whole.clone();
    flipped[whole.len() / 3] ^= 1;
    for (name, bytes, why) in
        [("cut", &whole[..whole.len() / 2], "cut at byte"), ("crc", &flipped, "the chunk at byte")]
    {
        let file = bench.path(&format!("{name}.mcap"));
        std::fs::write(&file, bytes).expect("writable");
        let path = file.display().to_string();
        let [copy, out] =
            ["copy", "out"].map(|kind| bench.path(&format!("{name}_{kind}")).display().to_string());
        let [source, bag] = ["source", "bag"].map(|key| arg(key, &file));
        let commands: [&[&str]; 4] = [
            &["bag", "convert", &path, &copy],
            &["bag", "play", &path, "--rate", "100"],
            &["eval", "launch/raw.launch.yaml", &source, "engine:=rten", "-o", &out],
            &["launch", "launch/replay.launch.yaml", &bag, "play_rate:=0", "engine:=rten"],
        ];
        for command in commands {
            let output = bench.run(command);
            let expected = text(&output);
            assert_eq!(output.status.code(), Some(3), "{command:?}: {expected}");
            assert!(expected.contains(why), "{command:?}: {expected}");
        }
    }
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
