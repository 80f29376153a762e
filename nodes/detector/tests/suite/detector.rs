//! The node on tiny models, without transport.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use modulo_core::Frame;
use modulo_detector::{
    CudnnSearch, Detector, DetectorError, DetectorParameters, EngineChoice, EngineDevice, EngineOptions,
    describe,
};
use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::std_msgs::{Header, Time};
use modulo_msgs::vision_msgs::Detection2DArray;
use modulo_runtime::lockstep::Lockstep;
use modulo_runtime::{
    Context, ManualClock, Message, MessageKind, Node, NodeName, ParameterError, ParameterSet, Parameters,
    SensorModel, StampedFrame, StepError, StepOutput, Topic, Trigger, sensor_info,
};
use ndarray::Array3;

fn data(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(file)
}

fn parameters(model: &Path, changes: &[(&str, &str)]) -> Parameters {
    let model = model.to_str().expect("a path");
    let all: Vec<_> = [("model", model), ("engine", "rten")].iter().chain(changes).copied().collect();
    Parameters::declare(DetectorParameters::descriptors()).with_text(&all).expect("allowed")
}

fn opened(model: &Path, changes: &[(&str, &str)]) -> Result<Detector, DetectorError> {
    Detector::new(&(&parameters(model, changes)).into())
}

fn detector(file: &str, changes: &[(&str, &str)]) -> Detector {
    opened(&data(file), changes).expect("a detector")
}

fn refusal(model: &Path, changes: &[(&str, &str)]) -> String {
    match opened(model, changes) {
        Ok(_) => panic!("{} with {changes:?} must be refused", model.display()),
        Err(error) => error.to_string(),
    }
}

fn image(frame: Frame) -> StampedFrame {
    let header = Header { stamp: Time { sec: 7, nanosec: 8 }, frame_id: "camera".into() };
    StampedFrame { header, frame }
}

fn grey(height: usize, width: usize, level: u8) -> Frame {
    Frame::from_u8(Array3::from_elem((height, width, 3), level)).expect("a frame")
}

/// All that one step sends for its image, and the stages that it books.
fn step(node: &mut Detector, frame: Frame, wanted: [bool; 2]) -> (Vec<(usize, Message)>, Vec<&'static str>) {
    let clock = ManualClock::at(0);
    let mut cx = Context::new("/detector", &clock, &wanted);
    let message = Message::Image(Arc::new(image(frame)));
    node.step(Trigger::Message { input: 0, message }, &mut cx).expect("a step");
    let StepOutput { messages, stages, .. } = cx.finish();
    // The meaning of the classes is sent once, and not for each image.
    let sent = messages.into_iter().filter(|(output, _)| *output < 2).collect();
    (sent, stages.into_iter().map(|(name, _)| name).collect())
}

fn detections(node: &mut Detector, frame: Frame) -> Detection2DArray {
    match step(node, frame, [true, false]).0.as_slice() {
        [(0, Message::Detections(array))] => Detection2DArray::clone(array),
        other => panic!("one array of detections expected, not {other:?}"),
    }
}

fn classes(array: &Detection2DArray) -> Vec<(String, f32)> {
    let reported = |one: modulo_core::Detection| (one.class, one.score);
    array.detections.iter().filter_map(|one| one.to_detection()).map(reported).collect()
}

#[test]
fn a_frame_gives_its_boxes_with_its_header() {
    let mut node = detector("rows.onnx", &[]);
    let array = detections(&mut node, grey(96, 160, 204));
    let header = image(grey(1, 1, 0)).header;
    assert_eq!(array.header, header);
    assert!(array.detections.iter().all(|one| one.header == header));
    let sent: Vec<_> = array.detections.iter().filter_map(|one| one.to_detection()).collect();
    assert_eq!(node.find(&grey(96, 160, 204)), Ok(sent), "without messages, the same");
    let reported = classes(&array);
    assert_eq!(reported[0], ("person".to_owned(), 0.9));
    // The last row's score is the mean of the tensor: 96 of 128 rows are the image.
    let mean = (204.0 * 0.75 + 114.0 * 0.25) / 255.0;
    assert!(reported[1].0 == "7" && (reported[1].1 - mean).abs() < 1e-4, "{reported:?}");
    assert_eq!(reported[2], ("car".to_owned(), 0.5));
    let car = array.detections[2].to_detection().expect("a box").bbox;
    assert_eq!((car.x1, car.y1, car.x2, car.y2), (8.0, 4.0, 40.0, 20.0));
}

#[test]
fn a_frame_without_detections_is_an_answer() {
    let mut node = detector("rows.onnx", &[("score_threshold", "1")]);
    let array = detections(&mut node, grey(128, 128, 0));
    assert!(array.detections.is_empty());
    assert_eq!(array.header.frame_id, "camera");
}

#[test]
fn the_annotated_image_is_drawn_only_when_wanted() {
    let mut node = detector("rows.onnx", &[]);
    let (sent, stages) = step(&mut node, grey(40, 50, 0), [true, false]);
    assert_eq!((sent.len(), stages), (1, vec!["pre", "infer", "post"]));
    let (sent, stages) = step(&mut node, grey(40, 50, 0), [true, true]);
    assert_eq!(stages, ["pre", "infer", "post", "draw"]);
    let drawn = sent.iter().find(|(output, _)| *output == 1).map(|(_, message)| message.clone());
    let Some(Message::Image(drawn)) = drawn else { panic!("an image expected on output 1") };
    assert_eq!(drawn.header, image(grey(1, 1, 0)).header);
    assert_eq!(drawn.frame.dim(), (40, 50, 3));
    assert_ne!(drawn.frame, grey(40, 50, 0));
}

#[test]
fn the_input_is_swapped_between_frames() {
    let mut node = detector("rows.onnx", &[]);
    assert_eq!(node.inputs()[0].name, "recovered");
    for input in ["modulo", "/camera/image_raw"] {
        node.configure(&parameters(&data("rows.onnx"), &[("input", input)])).expect("possible");
        assert_eq!((node.inputs()[0].name.as_str(), node.inputs()[0].kind), (input, MessageKind::Image));
        assert!(node.status().contains(&("stream", input.to_owned())));
        assert_eq!(detections(&mut node, grey(64, 64, 0)).detections.len(), 3);
    }
    let refused =
        node.configure(&parameters(&data("rows.onnx"), &[("input", "raw")])).expect_err("no stream");
    assert!(
        refused.to_string().contains("modulo, recovered, metered, saturated, auto_exposed, ideal"),
        "{refused}"
    );
    assert_eq!(node.inputs()[0].name, "/camera/image_raw", "goes on exactly as before");
}

/// cuDNN works on device cuda alone: elsewhere the parameter would be accepted and ignored.
#[test]
fn a_search_of_cudnn_is_refused_where_cudnn_does_not_work() {
    let search = ("cudnn_search", "exhaustive");
    for device in ["cpu", "tensorrt:1"] {
        let why = refusal(&data("rows.onnx"), &[("engine", "ort"), ("device", device), search]);
        assert!(why.contains("cudnn_search") && why.contains(&format!("the device is {device}")), "{why}");
    }
    let mut node = detector("rows.onnx", &[]);
    let [now, next] = [&[][..], &[search]].map(|changes| parameters(&data("rows.onnx"), changes));
    let why = change_parameters(&mut node, &now, &next).expect_err("on a processor").to_string();
    assert!(why.contains("needs device cuda"), "{why}");
    assert_eq!(detections(&mut node, grey(64, 64, 0)).detections.len(), 3, "goes on as before");
    // With cuda it is the device that is not here.
    let why = refusal(&data("rows.onnx"), &[("engine", "ort"), ("device", "cuda"), search]);
    assert!(!why.contains("cudnn_search"), "{why}");
}

#[test]
fn the_model_is_exchanged_or_refused() {
    let mut node = detector("rows.onnx", &[("classes", "person")]);
    let now = parameters(&data("rows.onnx"), &[("classes", "person")]);
    let first = |node: &mut Detector| classes(&detections(node, grey(64, 64, 0)))[0].0.clone();
    assert!(node.prepare(&now, &parameters(&data("rows.onnx"), &[("input", "modulo")])).is_none());

    // Made beside the node, and then exchanged.
    let next = parameters(&data("nameless.onnx"), &[("threads", "1")]);
    let part = node.prepare(&now, &next).expect("another model")().expect("it loads");
    assert_eq!(first(&mut node), "person", "the model that it has");
    node.exchange(&next, part).expect("possible");
    assert_eq!(first(&mut node), "0");
    assert!(node.state().contains(&("model", "nameless.onnx".to_owned())), "{:?}", node.state());

    // A model that does not load, and one that has no such class.
    let broken = parameters(&data("segments.onnx"), &[]);
    let why = node.prepare(&next, &broken).expect("another model")().expect_err("no detector").to_string();
    assert!(why.contains("'model' = ") && why.contains("for segmentation"), "{why}");
    let wrong = parameters(&data("rows.onnx"), &[("classes", "zebra")]);
    let why = node.prepare(&next, &wrong).expect("another model")().expect_err("no such class").to_string();
    assert!(why.contains("person, bicycle, car"), "{why}");
    assert_eq!(first(&mut node), "0", "goes on exactly as before");

    // A node loads nothing between two frames.
    let why = node.configure(&now).expect_err("it was not loaded").to_string();
    assert!(why.contains("'model' = ") && why.contains("was not loaded"), "{why}");
    change_parameters(&mut node, &next, &now).expect("possible");
    assert_eq!(first(&mut node), "person");

    // The first run at another size may take long, so that it belongs to the job as well.
    let sized = parameters(&data("rows.onnx"), &[("input_size", "96x64")]);
    assert!(node.prepare(&now, &sized).is_some());
}

/// The driver subscribes to the next inputs before the node takes its parameters.
#[test]
fn the_next_inputs_are_known_before_a_change() {
    let mut node = detector("rows.onnx", &[]);
    let now = parameters(&data("rows.onnx"), &[]);
    let names = |topics: Vec<Topic>| topics.into_iter().map(|topic| topic.name).collect::<Vec<_>>();
    let of_topic = [
        "/rear/image",
        "sensor_info",
        "recovered/sensor_info",
        "/rear/sensor_info",
        "/rear/recovered/sensor_info",
        "recovery",
    ];
    for (changes, later) in [
        (&[("input", "modulo")][..], &["saturated", "sensor_info"][..]),
        (&[("input", "auto"), ("fallback", "/rear/image")], &of_topic[..]),
        (&[("input", "auto")], &["saturated", "sensor_info", "recovery"]),
        (&[("fallback", "/rear/image")], &of_topic[..5]),
    ] {
        let next = parameters(&data("rows.onnx"), changes);
        let planned = node.inputs_with(&next).expect("possible");
        change_parameters(&mut node, &now, &next).expect("possible");
        assert_eq!(names(planned.first), names(node.inputs()), "{changes:?}");
        assert_eq!(names(planned.later), later, "{changes:?}");
    }
    assert!(node.inputs_with(&parameters(&data("rows.onnx"), &[("input", "a b")])).is_err());
}

#[test]
fn every_image_is_answered() {
    for size in ["auto", "96x64"] {
        let mut node = detector("rows.onnx", &[("input_size", size)]);
        for (height, width) in [(1, 1), (7, 3), (1, 4000), (33, 31), (375, 1242)] {
            for channels in [1, 3] {
                let shape = (height, width, channels);
                let frames = [
                    Frame::from_u8(Array3::from_elem(shape, 200)).expect("a frame"),
                    Frame::from_u16(Array3::from_elem(shape, 40_000)).expect("a frame"),
                ];
                for frame in frames {
                    let (sent, _) = step(&mut node, frame, [true, true]);
                    assert_eq!(sent.len(), 2, "{shape:?}");
                }
            }
        }
    }
}

#[test]
fn what_is_no_image_is_skipped() {
    let mut node = detector("rows.onnx", &[]);
    let clock = ManualClock::at(0);
    let broken = image(Frame::from_f32(Array3::zeros((4, 4, 3))).expect("a frame"));
    let array = Message::Detections(Arc::new(Detection2DArray::default()));
    for trigger in [
        Trigger::Tick,
        Trigger::Message { input: 0, message: array },
        Trigger::Message { input: 0, message: Message::Image(Arc::new(broken)) },
    ] {
        let mut cx = Context::new("/detector", &clock, &[true, true]);
        assert!(matches!(node.step(trigger, &mut cx), Err(StepError::Skip(_))));
        assert!(cx.finish().messages.is_empty());
    }
}

#[test]
fn bits_bring_the_sensor_to_the_models_range() {
    let dark = |level| Frame::from_u16(Array3::from_elem((128, 128, 1), level)).expect("a frame");
    for (bits, level, expected) in
        [("12", 2048, 128.0), ("0", 2048, 8.0), ("10", 1023, 255.0), ("4", 15, 255.0)]
    {
        let mut node = detector("rows.onnx", &[("bits", bits), ("score_threshold", "0")]);
        let reported = classes(&detections(&mut node, dark(level)));
        let (_, score) =
            reported.iter().find(|(class, _)| class == "7").expect("the score of this class is the level");
        assert!((score - expected / 255.0).abs() < 1e-4, "{bits} bits: {reported:?}");
    }
}

fn even(depth: u8, level: u16) -> Frame {
    let pixels = Array3::from_elem((128, 128, 3), level);
    if depth == 8 { Frame::from_u8(pixels.mapv(|v| v as u8)) } else { Frame::from_u16(pixels) }
        .expect("a frame")
}

/// Sends the description of a sensor of `bits` for the second `stamp`, and then an image of the second 7 on `stream`. Returns the bits and the
/// level with which it was read.
fn read_as(
    node: &mut Detector,
    (bits, stamp): (u8, i32),
    frame: Frame,
    stream: Option<&str>,
) -> (String, u8) {
    let (clock, wanted) = (ManualClock::at(0), [true, false]);
    let header = Header { stamp: Time { sec: stamp, nanosec: 8 }, frame_id: "camera".into() };
    let sensor = SensorModel { bits, ..SensorModel::default() };
    let message = sensor_info::message((&header, (96, 160)), &sensor, "/modulo_camera", []);
    let mut cx = Context::new("/detector", &clock, &wanted);
    // That beside the images, where they have a topic of their own.
    let beside =
        |topic: &Topic| topic.name.strip_suffix("sensor_info").is_some_and(|of| !of.ends_with("recovered/"));
    let input = node.inputs().iter().rposition(beside).expect("descriptions are read");
    node.step(Trigger::Message { input, message }, &mut cx).expect("a description");
    let message = Message::Image(Arc::new(image(frame)));
    let mut cx = Context::new("/detector", &clock, &wanted);
    cx.stream = stream;
    node.step(Trigger::Message { input: 0, message }, &mut cx).expect("a step");
    let answers = cx.finish().messages;
    let Some((0, Message::Detections(array))) = answers.first() else { panic!("{answers:?}") };
    let (_, score) =
        classes(array).into_iter().find(|(class, _)| class == "7").expect("its score is the level");
    let reported = node.state().into_iter().find(|(key, _)| *key == "bits").expect("in the state").1;
    (reported, (255.0 * score).round() as u8)
}

/// The bits of the sensor are those of its codes. Pictures have 8, and of an image of another name, which the camera may have sensed, they say
/// nothing.
#[test]
fn bits_belong_to_the_stream() {
    for bits in 1..=16 {
        let (depth, most) = (if bits <= 8 { 8 } else { 16 }, u16::MAX >> (16 - bits));
        for (input, frame, read) in [
            ("recovered", even(8, 200), (8, 200)),
            ("ideal", even(8, 40), (8, 40)),
            ("/front/recovered", even(8, 77), (8, 77)),
            ("modulo", even(depth, most), (bits, 255)),
            ("saturated", even(depth, most), (bits, 255)),
            ("/front/modulo", even(depth, most), (bits, 255)),
            ("/camera/image_raw", even(depth, u16::MAX >> (16 - depth)), (depth, 255)),
        ] {
            let is_foreign = input.starts_with("/camera");
            // The description of an earlier frame counts, too, and the parameter of the reader is about codes alone.
            for (sensor, stamp, given) in [(bits, 7, 0), (bits, 6, 0), (8, 7, bits)] {
                let given = if is_foreign { 0 } else { given }.to_string();
                let changes = [("input", input), ("bits", &given), ("score_threshold", "0")];
                let got = read_as(&mut detector("rows.onnx", &changes), (sensor, stamp), frame.clone(), None);
                assert_eq!(got, (read.0.to_string(), read.1), "{input}, {bits} bits, parameter {given}");
            }
        }
    }
}

/// While the input changes, the last images of the stream before still come.
#[test]
fn an_image_is_read_as_its_own_stream_has_it() {
    let with = |input| parameters(&data("rows.onnx"), &[("input", input), ("score_threshold", "0")]);
    for (bits, depth) in [(4, 8), (10, 16)] {
        let mut node = detector("rows.onnx", &[("score_threshold", "0")]);
        let modulo = even(depth, u16::MAX >> (16 - bits));
        let level = |node: &mut Detector, frame: &Frame, stream| {
            read_as(node, (bits, 7), frame.clone(), Some(stream)).1
        };
        assert_eq!(level(&mut node, &even(8, 200), "recovered"), 200);
        node.configure(&with("modulo")).expect("possible");
        assert_eq!(level(&mut node, &even(8, 200), "recovered"), 200);
        assert_eq!(level(&mut node, &modulo, "modulo"), 255);
        node.configure(&with("/front/recovered")).expect("possible");
        assert_eq!(level(&mut node, &modulo, "modulo"), 255);
        assert_eq!(level(&mut node, &even(8, 9), "/front/recovered"), 9);
    }
}

#[test]
fn a_class_map_is_read_when_it_changes_and_not_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("map.yaml");
    std::fs::write(&file, "person: walker\ncar: auto\n").expect("written");
    let map = ("class_map", file.to_str().expect("a path"));
    let mut node = detector("rows.onnx", &[map]);
    std::fs::remove_file(&file).expect("removed");
    let mut now = parameters(&data("rows.onnx"), &[map]);
    let mut set = |changes: &[(&str, &str)]| {
        let next = parameters(&data("rows.onnx"), changes);
        change_parameters(&mut node, &now, &next).map(|()| now = next)
    };
    set(&[map, ("score_threshold", "0.5")]).expect("the map is known");
    set(&[map, ("classes", "auto")]).expect("its names are known");
    let why = set(&[map, ("classes", "car")]).expect_err("renamed by the map").to_string();
    assert!(why.contains("walker, auto"), "{why}");
    set(&[]).expect("no map");
    let why = set(&[map]).expect_err("the file has gone").to_string();
    assert!(why.contains("class_map") && why.contains("No such file"), "{why}");
}

/// rten on one thread of the processor.
const RTEN: EngineOptions = EngineOptions {
    engine: EngineChoice::Rten,
    device: EngineDevice::Cpu,
    cudnn_search: CudnnSearch::Heuristic,
    threads: 1,
};

#[test]
fn names_come_from_metadata_then_a_file_then_numbers() {
    let folder = tempfile::tempdir().expect("a folder");
    let model = folder.path().join("mine.onnx");
    std::fs::copy(data("nameless.onnx"), &model).expect("copied");
    let known = |model: &Path| describe(model, RTEN).expect("a model").classes;
    assert_eq!(known(&data("rows.onnx")), ["person", "bicycle", "car"]);
    assert_eq!(known(&model), Vec::<String>::new());
    let mut node = opened(&model, &[]).expect("a detector");
    assert_eq!(classes(&detections(&mut node, grey(64, 64, 0)))[0].0, "0");
    std::fs::write(folder.path().join("mine.names"), "walker\n\nauto\n").expect("written");
    assert_eq!(known(&model), ["walker", "1", "auto"]);

    // A pipe would keep its reader for ever.
    std::fs::remove_file(folder.path().join("mine.names")).expect("there");
    std::os::unix::fs::symlink("/dev/zero", folder.path().join("mine.names")).expect("a link");
    let why = refusal(&model, &[]);
    assert!(why.contains("mine.names is not a regular file") && why.contains("one name a line"), "{why}");
}

#[test]
fn a_static_model_says_its_size() {
    let node = detector("static_96x64.onnx", &[]);
    assert!(node.status().contains(&("input_size", "96x64".to_owned())));
    let why = refusal(&data("static_96x64.onnx"), &[("input_size", "640x640")]);
    assert!(why.contains("input_size") && why.contains("640x640") && why.contains("96x64"), "{why}");
}

#[test]
fn facts_name_what_runs() {
    let node = detector("rows.onnx", &[("threads", "1"), ("input", "saturated")]);
    let status = node.status();
    for fact in [("engine", "rten"), ("model", "rows.onnx"), ("stream", "saturated"), ("threads", "1")] {
        assert!(status.contains(&(fact.0, fact.1.to_owned())), "{fact:?} in {status:?}");
    }
}

#[test]
fn models_that_cannot_work_say_what_is_needed() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = folder.path().join("text.onnx");
    for (name, content) in [
        ("text.onnx", "not a model"),
        ("best.pt", "PK\u{3}\u{4} and more"),
        ("renamed.onnx", "PK\u{3}\u{4} and more"),
        ("pointer.onnx", "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n"),
    ] {
        std::fs::write(folder.path().join(name), content).expect("written");
    }
    for (model, parts) in [
        (PathBuf::new(), &["model", "ONNX", "model:="][..]),
        (folder.path().join("none.onnx"), &["none.onnx", "No such file"]),
        (text, &["text.onnx", "cannot load"]),
        (folder.path().to_owned(), &["is not a regular file"]),
        (data("segments.onnx"), &["is a model for segmentation", "task detect"]),
        (folder.path().join("best.pt"), &["is a PyTorch file", "yolo export model=", "best.pt format=onnx"]),
        (folder.path().join("renamed.onnx"), &["is a PyTorch file", "renamed.pt format=onnx"]),
        (folder.path().join("pointer.onnx"), &["is a pointer of git LFS", "git lfs pull"]),
        (data("mono.onnx"), &["'images' [1, 1, ?, ?]", "[1, 3, H, W]"]),
    ] {
        let why = refusal(&model, &[]);
        assert!(parts.iter().all(|part| why.contains(part)) && !why.contains('\n'), "{why}");
    }
}

/// A car with a worse copy of it, a person in the same place, and a bicycle.
#[test]
fn raw_heads_give_one_box_an_object() {
    let of = |file: &str, changes: &[(&str, &str)]| {
        classes(&detections(&mut detector(file, changes), grey(96, 160, 0)))
    };
    let scored =
        |all: &[(&str, f32)]| all.iter().map(|&(class, score)| (class.to_owned(), score)).collect::<Vec<_>>();
    for file in ["columns.onnx", "rows_of_anchors.onnx"] {
        let rounded = |changes: &[(&str, &str)]| {
            let round = |(class, score): (String, f32)| (class, (score * 1e4).round() / 1e4);
            of(file, changes).into_iter().map(round).collect::<Vec<_>>()
        };
        let best = scored(&[("car", 0.8), ("person", 0.7), ("bicycle", 0.4)]);
        assert_eq!(rounded(&[]), best, "{file}");
        let all = scored(&[("car", 0.8), ("person", 0.7), ("car", 0.6), ("bicycle", 0.4)]);
        assert_eq!(rounded(&[("nms_iou", "0.95")]), all, "{file}");
        assert_eq!(rounded(&[("max_det", "2")]), best[..2], "{file}");
        assert_eq!(rounded(&[("classes", "bicycle"), ("max_det", "1")]), best[2..], "{file}");
        assert_eq!(rounded(&[("score_threshold", "0.45")]), best[..2], "{file}");
        let first = detections(&mut detector(file, &[]), grey(96, 160, 0)).detections[0]
            .to_detection()
            .expect("a box");
        let bbox = first.bbox;
        assert_eq!((bbox.x1, bbox.y1, bbox.x2, bbox.y2), (8.0, 4.0, 40.0, 20.0), "{file}");
    }
    // As many rows of 6 as three anchors for each cell of the input.
    let reported = of("one_class.onnx", &[]);
    assert!(
        matches!(&reported[..], [(class, score)] if class == "car" && (score - 0.45).abs() < 1e-4),
        "{reported:?}"
    );
}

/// Writes the model whose three rows and whose names are given.
fn with_rows(folder: &Path, rows: [[f32; 6]; 3], names: &str) -> PathBuf {
    let mut model = std::fs::read(data("rows.onnx")).expect("the model");
    let mut put = |after: &[u8], bytes: &[u8]| {
        let at =
            model.windows(after.len()).position(|window| window == after).expect("it is in it") + after.len();
        model[at..at + bytes.len()].copy_from_slice(bytes);
    };
    put(b"boxesJH", &rows.iter().flatten().flat_map(|value| value.to_le_bytes()).collect::<Vec<_>>());
    put(b"names\x12\x25", format!("{names:<37}").as_bytes());
    let path = folder.join("made.onnx");
    std::fs::write(&path, model).expect("written");
    path
}

#[test]
fn what_cannot_be_boxes_is_refused_at_the_start() {
    let folder = tempfile::tempdir().expect("a folder");
    let names = "['person', 'bicycle', 'car']";
    let good = [10.0, 20.0, 30.0, 40.0, 0.5, 2.0];
    let made = |rows| with_rows(folder.path(), rows, names);
    for (rows, part) in [
        ([[f32::NAN; 6], [f32::NAN; 6], good], "2 of 3 boxes have values that are no finite numbers"),
        ([[0.25, 0.25, 0.6, 0.75, 0.9, 2.0]; 3], "all boxes lie between 0 and 1"),
        (
            [[20.0, 15.0, 2.0, 2.0, 0.1, 0.0], [9.0, 9.0, 2.0, 2.0, 0.1, 1.0], good],
            "2 of 3 boxes have x2 < x1",
        ),
        ([[20.0, 15.0, 22.0, 22.0, 0.1, 0.93], [9.0, 9.0, 12.0, 12.0, 0.1, 0.25], good], "no whole number"),
        ([good, good, [10.0, 20.0, 30.0, 40.0, 7.0, 1.0]], "a score is 7"),
    ] {
        let why = refusal(&made(rows), &[]);
        assert!(why.contains(part) && why.contains("made.onnx") && why.contains("[1, N, 6]"), "{why}");
    }
    // Rows without a score fill up the output, and one box of several that is none is left out.
    for rows in
        [[[0.0; 6]; 3], [[0.0, 0.0, 0.0, 0.0, 0.0, -1.0], [0.0; 6], good], [good, good, [f32::NAN; 6]]]
    {
        detections(&mut opened(&made(rows), &[]).expect("a detector"), grey(64, 64, 0));
    }
    assert_eq!(describe(&made([good; 3]), RTEN).expect("a model").classes, ["person", "bicycle", "car"]);
}

#[test]
fn parameters_that_cannot_work_say_what_is_possible() {
    for (name, value, remedy) in [
        ("input", "p", "modulo, recovered, metered, saturated, auto_exposed, ideal"),
        ("input_size", "650x640", "multiples of 32"),
        ("classes", "zebra", "person, bicycle, car"),
        ("class_map", "/nowhere.yaml", "No such file"),
    ] {
        let why = refusal(&data("rows.onnx"), &[(name, value)]);
        assert!(why.contains(name) && why.contains(value) && why.contains(remedy), "{why}");
    }
}

/// Neither a cut nor a flipped byte of a model may take the node down.
#[test]
fn broken_model_files_are_refused_or_work() {
    let whole = std::fs::read(data("rows.onnx")).expect("the model");
    let folder = tempfile::tempdir().expect("a folder");
    let model = folder.path().join("broken.onnx");
    for at in 0..whole.len() {
        let mut flipped = whole.clone();
        flipped[at] ^= 0xff;
        for bytes in [&whole[..at], &flipped] {
            std::fs::write(&model, bytes).expect("written");
            if let Ok(mut node) = opened(&model, &[("threads", "1")]) {
                step(&mut node, grey(8, 8, 0), [true, true]);
            }
        }
    }
    std::fs::write(&model, &whole[..whole.len() / 2]).expect("written");
    assert!(refusal(&model, &[]).contains("cannot load"));
}

/// A clock on which every look takes longer than the one before.
#[derive(Default)]
struct Slower(std::sync::atomic::AtomicU64);

impl modulo_runtime::Clock for Slower {
    fn now_ns(&self) -> u64 {
        0
    }

    fn ticks_ns(&self) -> u64 {
        let looks = self.0.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        looks * looks
    }
}

#[test]
fn speed_is_the_median_run_at_each_size() {
    let timed = |file: &str| {
        let mut model = describe(&data(file), RTEN).expect("a model");
        let speeds = model.measure(&Slower::default()).expect("runs");
        speeds.iter().map(|speed| (speed.height, speed.width, speed.median_ns)).collect::<Vec<_>>()
    };
    // Looks are at 0, 1, 4, 9, 16, ...: run n takes 4 n + 1. Of 23 runs at each size the first three are not counted.
    assert_eq!(timed("rows.onnx"), [(192, 640, 4 * 13 + 1), (384, 1248, 4 * 36 + 1)]);
    assert_eq!(timed("static_96x64.onnx"), [(64, 96, 4 * 13 + 1)], "it takes no other");
}

/// Returns the streams that 30 frames are answered from, the frames 10 to 19 of which are not trusted.
fn answered(fallback: &str, psf_sigma: f64) -> Vec<&'static str> {
    let clock = ManualClock::at(0);
    let mut chain = Lockstep::new(&clock, vec!["/detector/detections".into()]);
    let node = detector("rows.onnx", &[("input", "auto"), ("fallback", fallback)]);
    chain.add(Box::new(node), &NodeName::new("detector", "/", &[]).expect("a name")).expect("names");
    let sensor = SensorModel { psf_sigma, ..SensorModel::default() };
    let mut streams = Vec::new();
    for frame in 0..30u64 {
        let now = frame * 100_000_000;
        let mut image = image(grey(96, 160, 204));
        image.header.stamp = Time::from_ns(now);
        let info = sensor_info::message((&image.header, (96, 160)), &sensor, "/modulo_camera", []);
        chain.feed("/sensor_info", info, now).expect("a step");
        let image = Message::Image(Arc::new(image));
        for stream in ["/saturated", "/metered"] {
            let answers = chain.feed(stream, image.clone(), now).expect("a step");
            streams.extend(answers.iter().map(|_| stream));
        }
        let trusted = !(10..20).contains(&frame);
        let value = KeyValue { key: "trusted".into(), value: trusted.to_string() };
        let status = vec![DiagnosticStatus { values: vec![value], ..DiagnosticStatus::default() }];
        let array = DiagnosticArray { status, ..DiagnosticArray::default() };
        chain.feed("/recovery", Message::Diagnostics(Arc::new(array)), now).expect("a step");
    }
    streams
}

/// Each frame is answered once. Five frames in a row that are not trusted lead to the other stream, five trusted ones back.
#[test]
fn auto_reads_the_fallback_while_the_recovered_image_is_not_trusted() {
    let fallen = |frame| if (15..25).contains(&frame) { "/saturated" } else { "/metered" };
    for (fallback, psf_sigma, falls) in [("saturated", 1.4, true), ("auto", 0.0, true), ("auto", 1.4, false)]
    {
        let expected = (0..30).map(|frame| if falls { fallen(frame) } else { "/metered" });
        let streams = answered(fallback, psf_sigma);
        assert!(streams.iter().copied().eq(expected), "{fallback} {psf_sigma} {streams:?}");
    }
    let why = refusal(&data("rows.onnx"), &[("fallback", "raw")]);
    assert!(why.contains("fallback") && why.contains("saturated"), "{why}");
}

/// Each camera has its own description of the sensor and its own topics.
#[test]
fn one_detector_answers_several_cameras() {
    let clock = ManualClock::at(0);
    let outputs = ["/detector/front/detections", "/detector/car/rear/detections"];
    let mut chain = Lockstep::new(&clock, outputs.map(String::from).to_vec());
    let node = detector("rows.onnx", &[("cameras", "[/front, /car/rear]"), ("input", "modulo")]);
    chain.add(Box::new(node), &NodeName::new("detector", "/", &[]).expect("a name")).expect("names");
    for frame in 0..4 {
        for (camera, output, bits) in [("/front", outputs[0], 8), ("/car/rear", outputs[1], 6)] {
            let mut image = image(grey(96, 160, 60));
            image.header.stamp = Time::from_ns(frame);
            let info = sensor_info::message(
                (&image.header, (96, 160)),
                &SensorModel { bits, ..SensorModel::default() },
                camera,
                [],
            );
            chain.feed(&format!("{camera}/sensor_info"), info, frame).expect("a step");
            let answers = chain.feed(&format!("{camera}/modulo"), Message::Image(Arc::new(image)), frame);
            let topics: Vec<_> = answers.expect("a step").into_iter().map(|(topic, _)| topic).collect();
            assert_eq!(topics, [output]);
        }
        let foreign = chain.feed("/modulo", Message::Image(Arc::new(image(grey(96, 160, 60)))), frame);
        assert!(foreign.expect("a step").is_empty());
    }
    for (cameras, named) in [("[front]", "absolute"), ("[/front, /front]", "once"), ("['/']", "absolute")] {
        assert!(refusal(&data("rows.onnx"), &[("cameras", cameras)]).contains(named), "{cameras}");
    }
    let why = refusal(&data("rows.onnx"), &[("cameras", "[/front]"), ("input", "/image")]);
    assert!(why.contains("no absolute topic"), "{why}");
}

/// The state of a detector is published when it has changed: what differs between cameras is no change.
#[test]
fn cameras_of_other_sizes_and_bits_have_one_state() {
    let mut node = detector("rows.onnx", &[("cameras", "[/front, /rear]"), ("input", "modulo")]);
    let clock = ManualClock::at(0);
    let mut states = Vec::new();
    for _ in 0..3 {
        for (camera, namespace, bits, height) in [(0, "/front", 8, 96), (1, "/rear", 6, 200)] {
            let image = image(grey(height, 160, 60));
            let sensor = SensorModel { bits, ..SensorModel::default() };
            let info = sensor_info::message((&image.header, (96, 160)), &sensor, namespace, []);
            let mut send = |input, message| {
                let mut cx = Context::new("/detector", &clock, &[true, false, true, false]);
                node.step(Trigger::Message { input, message }, &mut cx).expect("a step");
            };
            send(2 * camera + 1, info);
            send(2 * camera, Message::Image(Arc::new(image)));
            states.push(node.state());
        }
    }
    let value = |name| states[1].iter().find(|(key, _)| *key == name).expect("in the state").1.clone();
    assert_eq!((value("bits"), value("input_size")), ("8, 6".to_owned(), "auto 160x128, 160x224".to_owned()));
    assert!(states[1..].windows(2).all(|pair| pair[0] == pair[1]), "{states:?}");
}

/// Changes the parameters of `node` as a driver does, and waits for the part that the change needs.
fn change_parameters(node: &mut dyn Node, now: &Parameters, next: &Parameters) -> Result<(), ParameterError> {
    node.inputs_with(next)?;
    match node.prepare(now, next) {
        None => node.configure(next),
        Some(job) => node.exchange(next, job()?),
    }
}
