//! The launch files, run by the shipped binary: three processes, one process, lockstep. Recorded frames: the sample bag that comes with
//! the project, and real frames where the shared test data is at hand.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use modulo_bags::bag::{BagReader, BagTopic, BagWriter, Compression, Selection};
use modulo_runtime::MessageKind;
use serde_json::Value;

use crate::harness::{
    Bench, Peer, arg, assert_has, borrowed, cell, classes, data, evaluated, evaluated_classes, model, text,
    wait_until,
};

const RECOVERED: &str = "launch launch/recovered.launch.yaml source:=@/images model:=% alpha:=2 engine:=rten";

#[test]
fn three_processes_detect_on_every_frame_and_end_by_themselves() {
    let bench = Bench::new();
    bench.images(6);
    let message = bench.says(0, &format!("{RECOVERED} --summary @/summary.json"));
    let summary = bench.json("summary.json");
    let counts = [&summary["frames"], &summary["topics"]["/recovered"]["in"]];
    assert_eq!(counts.map(Value::as_u64), [Some(6); 2], "{summary}");
    assert_eq!(summary["topics"]["/detector/detections"]["out"], 6, "{summary}");
    assert_eq!(summary["engine"], "rten");
    assert!(summary["latency_ms"]["unwrap"]["p50"].as_f64().expect("measured") > 0.0);
    assert!(!classes(&summary, "recovered").is_empty(), "{summary}");
    assert_has(&message, &["p95 ms"]);
}

#[test]
fn a_sensor_file_describes_the_sensor_everywhere() {
    let bench = Bench::new();
    bench.images(2);
    for more in ["", "--compose"] {
        let message =
            bench.says(0, &format!("{RECOVERED} sensor:=sensors/two_gains.yaml gains:=none {more}"));
        assert_has(&message, &["/unwrap used checkerboard_gains 2"]);
    }
    let sensor = "--sensor sensors/two_gains.yaml --alpha 2";
    bench.says(0, &format!("simulate @/images/000000.png {sensor} -o @/out"));
    let row = &bench.json("out/results.json")[0];
    assert_eq!((&row["gains"], &row["psf_sigma"]), (&"checkerboard".into(), &0.0.into()), "{row}");
    let grid = "eval --source scene://day?frames=1&width=320&height=192 --stream recovered --engine rten";
    bench.says(0, &format!("{grid} {sensor} -o @/grid"));
    let cell = &bench.json("grid/results.json")["cells"][0];
    let words = ["gains", "mosaic"].map(|name| cell[name].as_str().expect("a word"));
    assert_eq!(words, ["checkerboard", "none"], "{cell}");
    let figures = ["psf_sigma", "read_noise", "full_well_electrons", "prnu", "hot_pixels"];
    let figures = figures.map(|name| cell[name].as_f64().expect("a number"));
    assert_eq!(figures, [0.0, 0.06, 10_000.0, 0.005, 1e-5], "{cell}");
}

/// A program that lies alone in a folder, as after an installation, and a command line that is run in an empty folder.
#[test]
fn the_files_of_the_suite_are_in_the_program() {
    let bench = Bench::new();
    let (program, empty, cache) = (bench.path("bin/modulo"), bench.path("empty"), bench.path("cache"));
    [&bench.path("bin"), &empty].iter().for_each(|folder| std::fs::create_dir(folder).expect("writable"));
    let here = env!("CARGO_BIN_EXE_modulo");
    std::fs::hard_link(here, &program)
        .or_else(|_| std::fs::copy(here, &program).map(drop))
        .expect("a program");
    let says_with = |cache: &Path, code: i32, line: &str| {
        let mut command = Command::new(&program);
        command.args(line.split(' ')).current_dir(&empty).env("ROS_DOMAIN_ID", bench.domain.id.to_string());
        command.env("XDG_CACHE_HOME", cache).env_remove("AMENT_PREFIX_PATH").env_remove("RUST_LOG");
        let output = command.output().expect("the program starts");
        assert_eq!(output.status.code(), Some(code), "modulo {line}\n{}", text(&output));
        text(&output)
    };
    let says = |code: i32, line: &str| says_with(&cache, code, line);
    let plans = ["recovered", "recovered.launch.yaml", "launch/recovered.launch.yaml"]
        .map(|name| says(0, &format!("launch --print {name} sensor:=sensors/mosaic.yaml")));
    assert!(
        plans[0].contains("sensors/mosaic.yaml") && plans.iter().all(|plan| *plan == plans[0]),
        "{plans:?}"
    );
    assert_has(
        &says(0, "launch recovered frames:=2 engine:=rten sensor:=sensors/mosaic.yaml"),
        &["frames 2,"],
    );
    let replayed = says(0, "launch replay bag:=bags/samples/tunnel play_rate:=0 engine:=rten");
    assert_has(&replayed, &["/unwrap used", "trusted 12 of 12 frames"]);
    assert_has(&says(0, "bag info bags/samples/tunnel"), &["/modulo"]);
    says(0, "eval launch/raw.launch.yaml frames:=1 engine:=rten -o out");
    assert_has(&says(2, "launch"), &["  recovered "]);

    // The copy is what runs from then on, with the files that it includes.
    assert_has(&says(0, "launch --copy recovered"), &["launch/sensor.launch.yaml", "sensors/arguments.yaml"]);
    let file = empty.join("launch/sensor.launch.yaml");
    let changed = std::fs::read_to_string(&file).expect("a copy").replace("camera) 4.0", "camera) 3.0");
    std::fs::write(&file, changed).expect("writable");
    assert_has(&says(0, "launch --print launch/recovered.launch.yaml"), &["alpha = 3.0"]);
    assert_has(&says(2, "launch --copy recovered"), &["launch/recovered.launch.yaml", "exists already"]);
    assert_has(&says(0, "launch --print compare"), &["alpha = 4.0"]);
    assert_has(&says(0, "launch --copy compare"), &["sensor.launch.yaml (was there already, and is kept)"]);
    assert_has(&says(2, "launch recoverd"), &["are found), did you mean 'recovered'?"]);
    assert_has(&says(2, "launch --copy none"), &["none: no such launch file"]);
    // The sample is no copy, and a file is no folder.
    let why = says_with(&program, 1, "bag info bags/samples/tunnel");
    assert_has(&why, &["cannot be written from the program", "set XDG_CACHE_HOME"]);
}

#[test]
fn processes_one_process_and_lockstep_give_the_same_boxes() {
    let bench = Bench::new();
    bench.images(5);
    let file = "launch/raw.launch.yaml source:=@/images model:=% alpha:=2 engine:=rten";
    let [processes, process] = ["", "--compose"].map(|more| {
        bench.says(0, &format!("launch {file} --summary @/summary.json {more}"));
        classes(&bench.json("summary.json"), "modulo")
    });
    bench.says(0, &format!("eval {file} -o @/out"));
    assert!(!processes.is_empty());
    assert_eq!(process, processes);
    assert_eq!(evaluated_classes(&bench.path("out"), "modulo"), processes);
}

#[test]
fn lockstep_writes_the_same_bytes_twice() {
    let bench = Bench::new();
    bench.images(4);
    // The noise is drawn from a seed, so it must not differ between the two runs either. Nor must the work that is left out.
    let noise = "read_noise:=40 seed:=7 budget:=0.2 engine:=rten";
    let once = || {
        let (file, out) = ("launch/compare.launch.yaml source:=@/images model:=%", bench.path("out"));
        let _ = std::fs::remove_dir_all(&out);
        bench.says(0, &format!("eval {file} --images {noise} -o @/out"));
        assert_eq!(cell(&out, "recovered")["trusted"], 0.0, "what exceeds the budget");
        let boxes = ["ideal", "recovered", "saturated", "modulo"].map(|stream| evaluated(&out, stream));
        let files = ["results.json", "report.html", "modulo/000003.png", "recovered/000003.png"];
        (boxes, files.map(|file| std::fs::read(out.join(file)).expect("written")))
    };
    let first = once();
    let is_over = AtomicBool::new(false);
    let end = Instant::now() + Duration::from_secs(60);
    std::thread::scope(|scope| {
        (0..8).for_each(|_| {
            _ = scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed) && Instant::now() < end {
                    std::hint::spin_loop()
                }
            })
        });
        let again = once();
        is_over.store(true, Ordering::Relaxed);
        assert!(again == first, "beside other work");
    });
}

#[test]
fn each_camera_is_answered_on_a_topic_of_its_own() {
    for (shared, topics) in [
        ("shared:=false", ["/front/detector/detections", "/rear/detector/detections"]),
        ("shared:=true", ["/detector/front/detections", "/detector/rear/detections"]),
    ] {
        let bench = Bench::new();
        bench.images(3);
        let cameras = "front:=@/images rear:=@/images model:=% engine:=rten rate:=5.0 loop:=true";
        let running = bench.starts(&format!("launch launch/cameras.launch.yaml {cameras} {shared}"));
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
    let image = bench.images(1).join("000000.png");
    for folder in ["truncated", "kitti/image_2", "kitti/label_2"] {
        std::fs::create_dir_all(bench.path(folder)).expect("writable");
    }
    let write = |name: &str, bytes: &[u8]| std::fs::write(bench.path(name), bytes).expect("writable");
    // A picture that ends in the middle: the header promises more rows than there are.
    let whole = std::fs::read(image).expect("readable");
    write("truncated/000000.png", &whole[..whole.len() / 2]);
    write("kitti/image_2/000000.png", &whole);
    write("kitti/label_2/000000.txt", b"Car 0.0 0\n");
    image::Rgb32FImage::from_pixel(4, 4, image::Rgb([f32::NAN; 3]))
        .save(bench.path("nan.exr"))
        .expect("writable");
    image::RgbImage::new(64, 48).save(bench.path("cut.jpg")).expect("writable");
    let whole = std::fs::read(bench.path("cut.jpg")).expect("readable");
    write("cut.jpg", &whole[..whole.len() - 40]);
    let deep = image::ImageBuffer::from_pixel(64, 48, image::Luma([4000_u16]));
    deep.save(bench.path("deep.png")).expect("writable");

    let segments = format!("source:=@/images model:={}", model().replace("rows", "segments"));
    let cases: [(&str, &[&str]); 12] = [
        ("source:=/no/such/folder model:=%", &["/no/such/folder"]),
        ("source:=@/truncated model:=%", &["000000.png"]),
        ("source:=@/nan.exr model:=%", &["nan.exr", "NaN"]),
        ("source:=@/cut.jpg model:=%", &["cut.jpg", "truncated"]),
        ("source:=@/deep.png model:=%", &["deep.png", "4000", "white", "4096"]),
        ("source:=@/images model:=% alpha:=0", &["alpha", "0", "256"]),
        ("source:=@/images model:=% bits:=0", &["bits", "0", "to 16"]),
        ("source:=@/images model:=% bits:=17", &["bits", "17", "to 16"]),
        (&segments, &["segments.onnx", "for segmentation"]),
        ("source:=@/images model:=% colour:=red", &["colour", "alpha"]),
        ("/no/such.launch.yaml", &["/no/such.launch.yaml"]),
        ("launch/suite.launch.yaml source:=@/images input:=recoverd", &["input", "recoverd", "saturated"]),
    ];
    for (line, named) in cases {
        let file = if line.contains(".yaml") { "" } else { "launch/recovered.launch.yaml" };
        let words = bench.words(&format!("launch --compose {file} {line}"));
        let output = bench.run(&borrowed(&words));
        let complaint = text(&output);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{line}: {:?} {complaint}", output.status);
        let lines: Vec<_> = complaint.lines().filter(|line| line.starts_with("modulo: ")).collect();
        assert_eq!(lines.len(), 1, "{line}: {complaint}");
        assert_has(lines[0], named);
        assert!(!complaint.contains("panicked"), "{complaint}");
    }
}

/// A command whose results cannot be written runs nothing. Hours of work ended with an error about the folder of the results.
#[test]
fn an_output_that_cannot_be_written_is_refused_before_the_run() {
    let bench = Bench::new();
    std::fs::create_dir_all(bench.path("kitti/image_2")).expect("writable");
    let image = bench.images(1).join("000000.png");
    std::fs::copy(&image, bench.path("kitti/image_2/000000.png")).expect("copied");
    // Root can write nearly everywhere, but nobody can below a file.
    let out = format!("{}/out", image.display());
    for line in [
        "RECOVERED --summary OUT",
        "RECOVERED --summary /no/dir/s.json",
        "RECOVERED --summary @/images",
        "RECOVERED --compose --summary OUT",
        "RECOVERED --trace OUT",
        "bag record -o OUT",
        "bag convert bags/samples/tunnel OUT",
        "simulate @/images/000000.png -o OUT",
        "simulate @/images/000000.png -o /proc/x",
        "unwrap @/images/000000.png --alpha 4 -o OUT",
        "eval --source scene://day?frames=4 --engine rten -o OUT",
        "eval --source scene://day?frames=4 --engine rten -o /proc/x",
        "eval launch/raw.launch.yaml -o OUT",
        "eval launch/raw.launch.yaml -o /proc/x",
        "eval stability -o OUT",
    ] {
        let line = line.replace("RECOVERED", RECOVERED).replace("OUT", &out);
        let complaint = bench.says(2, &line);
        assert_eq!(complaint.lines().count(), 1, "{line} has run something: {complaint}");
        let words = bench.words(&line);
        let option = words.iter().position(|word| ["-o", "--summary", "--trace"].contains(&word.as_str()));
        let path = option.map_or(&out, |option| &words[option + 1]);
        assert_has(&complaint, &[path, "written"]);
        assert_eq!(complaint.matches("os error").count(), 1, "{line} tells its cause once: {complaint}");
    }
}

/// The disk may be full when the run is over: what was counted is printed first.
#[test]
fn a_summary_that_cannot_be_written_at_the_end_is_printed() {
    let bench = Bench::new();
    bench.images(2);
    for option in ["--summary", "--trace"] {
        let words = bench.words(&format!("{RECOVERED} {option} /dev/full"));
        let output = bench.run(&borrowed(&words));
        let complaint = text(&output);
        assert_eq!(output.status.code(), Some(1), "{complaint}");
        let summary = String::from_utf8_lossy(&output.stdout);
        assert!(summary.contains("2 frames") && complaint.contains("/dev/full"), "{option}: {complaint}");
    }
}

#[test]
fn a_refusing_node_ends_the_launch() {
    let bench = Bench::new();
    bench.images(1);
    let message = bench.says(2, &RECOVERED.replace('%', "/no/such/model.onnx"));
    assert_has(&message, &["/no/such/model.onnx"]);
}

/// The declarations of the nodes are part of what a launch file can break.
#[test]
fn print_shows_the_plan_or_the_mistake_with_its_line() {
    let bench = Bench::new();
    for file in ["raw", "recovered", "compare", "suite"] {
        let message = bench.says(0, &format!("launch --print launch/{file}.launch.yaml"));
        assert_has(&message, &["node /modulo_camera: modulo/modulo_camera"]);
    }
    let cases: [(&str, &[&str]); 2] = [
        ("launch:\n  - executable: { cmd: \"$(var nope)\" }\n", &["yaml:2: undefined variable 'nope'"]),
        (
            "launch:\n  - node: { pkg: modulo, exec: unwarp }\n  - node:\n      pkg: modulo\n      exec: unwrap\n      \
             param: [{ name: alhpa, value: 2.0 }, { name: bits, value: 99 }]\n",
            &[
                "bad.launch.yaml:2: node 'unwarp' is unknown",
                "bad.launch.yaml:3: parameter 'alhpa' = 2.0: unknown parameter",
                "bad.launch.yaml:3: parameter 'bits' = 99: must be in 0 to 16",
            ],
        ),
    ];
    for (bad, mistakes) in cases {
        std::fs::write(bench.path("bad.launch.yaml"), bad).expect("writable");
        assert_has(&bench.says(2, "launch --print @/bad.launch.yaml"), mistakes);
    }
    assert_has(&bench.says(2, "launch @/bad.launch.yaml"), &["bad.launch.yaml:2: node 'unwarp' is unknown"]);
}

/// Parameters for all nodes of a stack are no mistakes of its launch file, those written at a node of the suite are.
#[test]
fn print_tells_parameters_of_other_nodes_from_misspelt_ones() {
    let bench = Bench::new();
    let parameters = bench.path("stack.yaml");
    let check = |code: i32, stack: &str, own: &str| {
        std::fs::write(&parameters, format!("{stack}\n")).expect("writable");
        let from = parameters.display();
        let text = format!(
            "launch:\n  - node:\n      pkg: modulo\n      exec: unwrap\n      param: [{{ from: \"{from}\" }}{own}]\n"
        );
        std::fs::write(bench.path("stack.launch.yaml"), text).expect("writable");
        bench.says(code, "launch --print @/stack.launch.yaml")
    };
    check(0, "/**: {ros__parameters: {robot_base_frame: base_link}}", "");
    for (stack, own, named) in [
        ("/unwrap: {ros__parameters: {robot_base_frame: a}}", "", "robot_base_frame"),
        ("/**: {ros__parameters: {psf_sgima: 1.0}}", "", "did you mean 'psf_sigma'?"),
        ("/**: {ros__parameters: {}}", ", { name: wheel_radius, value: 0.4 }", "wheel_radius"),
        ("/**: {ros__parameters: {bits: 99}}", "", "must be in 0 to 16"),
    ] {
        let message = check(2, stack, own);
        assert!(message.contains(named), "{stack}{own}: {message}");
    }
    bench.says(2, "launch @/stack.launch.yaml");
}

/// A shell completes commands, options and launch files, and what only a running suite knows.
#[test]
fn a_shell_completes_what_is_there() {
    let bench = Bench::new();
    let completed = |line: &str| {
        let words: Vec<&str> = line.split(' ').collect();
        let mut asked = bench.modulo(&[&["--", "modulo"], &words[..]].concat());
        asked.env("COMPLETE", "bash").env("_CLAP_COMPLETE_INDEX", words.len().to_string());
        let output = asked.env("_CLAP_IFS", "\n").output().expect("starts");
        String::from_utf8(output.stdout).expect("UTF-8").lines().map(str::to_owned).collect::<Vec<_>>()
    };
    let script = bench.modulo(&[]).env("COMPLETE", "bash").output().expect("starts");
    assert_has(&String::from_utf8_lossy(&script.stdout), &["complete -o nospace"]);
    assert_eq!(completed("la"), ["launch"]);
    assert_eq!(completed("bag play --rat"), ["--rate"]);
    assert_eq!(completed("launch recov"), ["recovered"]);
    assert_eq!(completed("launch recovered psf_s"), ["psf_sigma:="]);
    assert_eq!(completed("detect picture.png score"), ["score_threshold:="]);
    let _unwrap = bench.start(&["run", "unwrap"]);
    wait_until("the node", || completed("param get /un") == ["/unwrap"]);
    assert_eq!(completed("param set /unwrap optic"), ["optical_black"]);
    assert_eq!(completed("topic echo /hd"), ["/hdr"]);
}

/// The second model answers in no time, and finds nothing.
#[test]
fn engines_and_models_are_evaluated_in_one_run() {
    let (bench, fast) = (Bench::new(), model());
    let frames = "--source scene://day?seed=3&frames=4&width=320&height=128 --stream recovered --method auto --deblur off";
    let vary =
        |engines: &str| format!("{engines} --vary detector.model=demo,% --alpha 4 --time-frames 4 -o @");
    bench.says(0, &format!("eval {frames} --vary detector.engine=rten,auto {}", vary("")));
    let cells = bench.json("results.json")["cells"].as_array().expect("cells").clone();
    assert_eq!(cells.len(), 4, "two engines with two models: {cells:?}");
    let infer = |cell: &Value| cell["latency_ms"]["infer"]["p50"].as_f64().expect("a time");
    let of = |model: &str| cells.iter().filter(|cell| cell["model"] == model).collect::<Vec<_>>();
    let (right, wrong) =
        (of("demo"), of(Path::new(&fast).file_stem().and_then(|name| name.to_str()).expect("a name")));
    assert!(right.iter().all(|cell| cell["ap50"]["vehicle"].as_f64() > Some(0.5)), "{cells:?}");
    assert!(wrong.iter().all(|cell| cell["ap50"]["vehicle"] == 0.0), "{cells:?}");
    assert!(right.iter().all(|cell| infer(cell) > infer(wrong[0])), "{cells:?}");
    let engines: Vec<_> = right.iter().map(|cell| cell["more"]["detector.engine"].as_str()).collect();
    assert_eq!(engines, [None, Some("rten")], "{cells:?}");
    let missing =
        bench.says(2, &format!("eval {frames} --vary detector.device=cpu,cuda {}", vary("--fresh")));
    let reasons = ["engine 'ort'", "cuda"];
    assert!(reasons.iter().any(|reason| missing.contains(reason)), "no GPU where the tests run: {missing}");
}

fn sample() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("bags/samples/tunnel")
}

/// The command of docs/reference/bags.md makes the very bytes that are committed.
#[test]
fn the_sample_is_made_by_its_command() {
    let bench = Bench::new();
    let source = "source:=scene://tunnel?seed=3&frames=12 rate:=4 engine:=rten";
    let bag = "--bag @/tunnel --topics /modulo /sensor_info /ground_truth";
    bench.says(0, &format!("eval launch/recovered.launch.yaml {source} -o @/out {bag}"));
    for file in ["tunnel_0.mcap", "metadata.yaml"] {
        let [made, committed] =
            [bench.path("tunnel"), sample()].map(|bag| std::fs::read(bag.join(file)).expect("readable"));
        assert!(made == committed, "{file} differs from the committed one");
    }
}

/// They would wait for a minute without a word.
#[test]
fn nodes_that_wait_for_each_other_are_refused() {
    let bench = Bench::new();
    for (of_first, of_second, circle) in [
        ("first", "elsewhere", Some("/first -> /first")),
        ("/second", "first", Some("/first -> /second -> /first")),
        ("second, elsewhere", "elsewhere", None),
    ] {
        let node = |name: &str, others: &str| {
            format!(
                "  - node:\n      pkg: modulo\n      exec: unwrap\n      name: {name}\n      param: [{{ name: wait_for, value: [{others}] \
                 }}]\n"
            )
        };
        let file = format!("launch:\n{}{}", node("first", of_first), node("second", of_second));
        std::fs::write(bench.path("waits.launch.yaml"), file).expect("writable");
        let code = if circle.is_some() { 2 } else { 0 };
        let checked = bench.says(code, "launch @/waits.launch.yaml --print");
        if let Some(circle) = circle {
            assert_has(&checked, &[circle, "take one name out"]);
            assert_has(&bench.says(2, "launch @/waits.launch.yaml"), &[circle]);
        }
    }
}

#[test]
fn two_gains_and_a_mosaic_are_recovered_by_the_suite() {
    let bench = Bench::new();
    for (out, sensor, told) in [
        ("gains", "psf_sigma:=0.0 gains:=checkerboard", ("method", "checkerboard_gains".into())),
        ("mosaic", "psf_sigma:=1.4 alpha:=2.0 mosaic:=grbg", ("trusted", Value::from(1.0))),
    ] {
        let source = "source:=scene://tunnel?seed=3&frames=2 engine:=rten";
        bench.says(0, &format!("eval launch/recovered.launch.yaml {source} {sensor} -o @/{out}"));
        let (figure, value) = told;
        assert_eq!(cell(&bench.path(out), "recovered")[figure], value, "{out}");
    }
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
    two_cameras(&bench.path("two"));
    let replay = "launch launch/replay.launch.yaml play_rate:=0 engine:=rten --summary @/summary.json";
    let replay = bench.words(replay);
    let (whole, two) = (arg("bag", sample()), arg("bag", bench.path("two")));
    let of_rear = ["bag_topic:=/rear cam/modulo", "bag_sensor_info:=/rear cam/sensor_info"];
    for (bag, topics) in [(&*whole, &[][..]), (&two, &of_rear)] {
        let words: Vec<&str> = replay.iter().map(String::as_str).chain([bag]).collect();
        let message = bench.ends(0, &[&words, topics].concat());
        assert!(!message.contains("DURABILITY"), "{message}");
        let summary = bench.json("summary.json");
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
    two_cameras(&bench.path("two"));
    let eval = "eval launch/raw.launch.yaml source:=@/two engine:=rten -o @/out";
    assert_has(&bench.says(2, eval), &["2 image topics", "'source_topic:=/front/modulo'"]);
    let words = bench.words(eval);
    let words = borrowed(&words);
    bench.ends(0, &[&words[..], &["source_topic:=/rear cam/modulo"]].concat());
    assert_eq!(bench.json("out/results.json")["input"]["frames"], 12);

    let print = bench.words("launch --print launch/cameras.launch.yaml front:=@/two rear:=@/two");
    let topics = ["front_topic:=/front/modulo", "rear_topic:=/rear cam/modulo"];
    let print: Vec<&str> = print.iter().map(String::as_str).chain(topics).collect();
    assert_has(
        &bench.ends(0, &print),
        &["source_topic = /front/modulo", "source_topic = '/rear cam/modulo'"],
    );
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
        std::fs::write(bench.path(&format!("{name}.mcap")), bytes).expect("writable");
        for command in [
            "bag convert @/NAME.mcap @/NAME_copy",
            "bag play @/NAME.mcap --rate 100",
            "eval launch/raw.launch.yaml source:=@/NAME.mcap engine:=rten -o @/NAME_out",
            "launch launch/replay.launch.yaml bag:=@/NAME.mcap play_rate:=0 engine:=rten",
        ] {
            let message = bench.says(3, &command.replace("NAME", name));
            assert!(message.contains(why), "{command} {name}: {message}");
        }
    }
}

#[test]
fn cars_and_persons_are_found_on_the_recovered_stream() {
    let data = [("source", "data/kitti_object"), ("model", "models/yolov10n_dyn_w16.onnx")];
    let [Some(source), Some(model)] = data.map(|(name, path)| Some(arg(name, data::shared(path)?))) else {
        return;
    };
    let bench = Bench::new();
    let file = "eval launch/recovered.launch.yaml psf_sigma:=1.4 engine:=rten alpha:=2";
    bench.says(0, &format!("{file} {source} {model} -o @"));
    let found = evaluated_classes(bench.folder.path(), "recovered");
    assert!(found["car"] >= 60 && found["person"] >= 5, "{found:?}");
    let frames = evaluated(bench.folder.path(), "recovered");
    assert_eq!(frames.len(), 20);
    for b in frames.iter().flat_map(|frame| frame["boxes"].as_array().expect("boxes")) {
        let [x1, y1, x2, y2] = [0, 1, 2, 3].map(|i| b[0][i].as_f64().expect("a number"));
        assert!(0.0 <= x1 && x1 < x2 && x2 <= 1242.0 && 0.0 <= y1 && y1 < y2 && y2 <= 376.0, "{b:?}");
    }
}
