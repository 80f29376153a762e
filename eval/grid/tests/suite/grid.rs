//! Runs of a grid on rendered scenes. Two runs are equal, unless a node depends on the wall clock; three merged captures have
//! ghosts where one capture has none; each frame of several sources in one bag has its own time stamp and labels.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use clap::Parser as _;
use modulo_ap::Difficulty;
use modulo_bags::bag::{BagReader, BagWriter, Compression, Selection};
use modulo_bags::source::{GroundTruth, SourceOptions, open};
use modulo_camera::{CameraParameters, ModuloCamera};
use modulo_core::Frame;
use modulo_detector::{DetectorParameters, EngineChoice};
use modulo_eval::grid::{
    Axes, Data, GridError, GridEvent, GridOptions, MakeDetector, Request, detector, draw_pictures, run,
};
use modulo_eval::launch_file::{CameraPlan, Evaluation, EvaluationPlan, Recordings};
use modulo_eval::report;
use modulo_eval::results::{Cell, Provenance, Results, Stream};
use modulo_images::save_png;
use modulo_msgs::vision_msgs::Detection2DArray;
use modulo_runtime::lockstep::Lockstep;
use modulo_runtime::{
    Context, Flow, ManualClock, Message, Node, NodeName, ParameterError, ParameterSet as _, Parameters,
    StepError, SystemClock, Topic, Trigger,
};
use modulo_unwrap::{UnwrapNode, UnwrapParameters};
use ndarray::Array3;

/// A detector that depends on the wall clock.
struct DriftingDetector(Box<dyn Node>);

fn drifting_detector(with: &DetectorParameters) -> Result<Box<dyn Node>, GridError> {
    Ok(Box::new(DriftingDetector(detector(with)?)))
}

impl Node for DriftingDetector {
    fn inputs(&self) -> Vec<Topic> {
        self.0.inputs()
    }

    fn outputs(&self) -> Vec<Topic> {
        self.0.outputs()
    }

    fn status(&self) -> Vec<(&'static str, String)> {
        self.0.status()
    }

    fn configure(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        self.0.configure(parameters)
    }

    fn step(&mut self, trigger: Trigger, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        let wanted = [true; 2];
        let clock = SystemClock::default();
        let mut inner = Context::new(cx.node(), &clock, &wanted[..1]);
        let flow = self.0.step(trigger, &mut inner)?;
        static FIRST: OnceLock<Instant> = OnceLock::new();
        for (output, message) in inner.finish().messages {
            let Message::Detections(array) = message else { continue };
            // The deliberate mistake: the clock moves all boxes but those of the very first image, by 1 px each ms.
            let drift = 1e3 * FIRST.get_or_init(Instant::now).elapsed().as_secs_f64();
            let mut array: Detection2DArray = (*array).clone();
            array.detections.iter_mut().for_each(|d| d.bbox.center.position.x += drift);
            cx.emit(output, Message::Detections(array.into()));
        }
        Ok(flow)
    }
}

fn still_request(out: &Path) -> Request {
    let axes = Axes::parse_from(["grid", "--stream", "ideal", "--alpha", "2"]);
    Request {
        data: Data::Any(vec!["scene://day?seed=3&frames=3&width=320&height=128".to_owned()]),
        options: GridOptions {
            axes,
            engine: EngineChoice::Rten,
            jobs: 1,
            time_frames: 0,
            ..GridOptions::default()
        },
        provenance: Provenance::default(),
        out: out.to_owned(),
    }
}

/// The cells of a new run without their durations.
fn cells(make: &MakeDetector) -> Vec<Cell> {
    let folder = tempfile::tempdir().expect("a folder");
    let outcome =
        run(&still_request(folder.path()), make, &SystemClock::default(), &|_| {}).expect("evaluated");
    let timeless = |cell: Cell| Cell { latency_ms: Default::default(), frame_ms: None, ..cell };
    outcome.cells.into_iter().map(timeless).collect()
}

#[test]
fn two_runs_are_the_same_and_a_look_at_the_clock_is_seen() {
    let steady = cells(&detector);
    assert!(steady[0].ap50["vehicle"].is_some_and(|ap| ap > 0.2), "{:?}", steady[0].ap50);
    assert_eq!(steady, cells(&detector));
    let drifting = cells(&drifting_detector);
    assert_ne!(drifting, cells(&drifting_detector), "a wall clock in a step must not go unseen");
    assert_ne!(drifting, steady);
}

fn request(data: Data, streams: &[Stream], out: &Path) -> Request {
    let options = ["grid", "--method", "auto", "--deblur", "off", "--alpha", "4", "--headroom", "1"];
    let axes = Axes { stream: streams.to_vec(), ..Axes::parse_from(options) };
    let options =
        GridOptions { axes, engine: EngineChoice::Rten, jobs: 2, time_frames: 1, ..GridOptions::default() };
    Request { data, options, provenance: Provenance::default(), out: out.to_owned() }
}

fn results(request: &Request) -> Result<Results, GridError> {
    run(request, &detector, &SystemClock::default(), &|_: GridEvent<'_>| {})
}

fn cell(results: &Results, stream: Stream) -> &Cell {
    results.cells.iter().rev().find(|cell| cell.point.stream == stream).expect("the cell")
}

#[test]
fn an_exposure_that_follows_the_frames_is_the_same_however_many_workers_there_are() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = |seed: u8| format!("scene://glare?seed={seed}&frames=60&width=240&height=96&light=tunnels");
    let streams = [Stream::AutoExposed, Stream::Metered, Stream::Recovered];
    let cells = |jobs, out: &str| {
        let data = Data::Any([3, 4].map(scene).to_vec());
        let mut request = request(data, &streams, &folder.path().join(out));
        let delays =
            ["grid", "--method", "auto", "--deblur", "off", "--alpha", "4", "--exposure-delay", "1,3"];
        request.options.axes = Axes { stream: streams.to_vec(), ..Axes::parse_from(delays) };
        (request.options.jobs, request.options.time_frames) = (jobs, 0);
        results(&request).expect("results").cells
    };
    let (one, three) = (cells(1, "one"), cells(3, "three"));
    // The delay matters to the camera that follows alone.
    assert_eq!(one.len(), 4);
    assert_eq!(one, three);
    let moments = |cell: &Cell| {
        cell.moments.iter().map(|moment| (moment.is_darker, moment.frame, moment.frames)).collect::<Vec<_>>()
    };
    // Two drives, each with one change at frame 50, of which 6 frames before it and 10 after it are there.
    let expected: Vec<_> = (-3..5).map(|half| (true, 2 * half, 4)).collect();
    assert!(one.iter().all(|cell| moments(cell) == expected), "{:?}", moments(&one[0]));
    let of = |stream| one.iter().find(|cell| cell.point.stream == stream).expect("its cell");
    let (metered, recovered) = (of(Stream::Metered), of(Stream::Recovered));
    assert_eq!(metered.exact_k, recovered.exact_k);
    assert_eq!(metered.psnr_db, recovered.psnr_db, "the quality is that of the recovered image");
    assert!(metered.nearest >= recovered.nearest, "{:?} {:?}", metered.nearest, recovered.nearest);
}

#[test]
fn what_moves_has_ghosts_in_three_captures_and_none_in_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let streams = [Stream::Ideal, Stream::Recovered, Stream::MultiExposure, Stream::MultiExposureStill];
    let scene = "scene://glare?seed=3&frames=6&width=480&height=144";
    let request = request(Data::Any(vec![scene.to_owned()]), &streams, folder.path());
    let results = results(&request).expect("results");
    let psnr = |stream| cell(&results, stream).psnr_db.unwrap_or(f64::INFINITY);
    let [one, moving, still] =
        [Stream::Recovered, Stream::MultiExposure, Stream::MultiExposureStill].map(psnr);
    assert!(still > 45.0, "merged captures of a still scene are nearly ideal: {still} dB");
    assert!(moving < still - 10.0, "the ghosts: {moving} dB against {still} dB");
    assert!(one > moving + 10.0, "one capture has none: {one} dB against {moving} dB");
    let merged = cell(&results, Stream::MultiExposure);
    assert_eq!((merged.frames, merged.exact_k), (6, None));
    assert!(merged.latency_ms.contains_key("merge"));

    let pictures = draw_pictures(&request, &detector, &SystemClock::default(), &results).expect("pictures");
    report::save_pictures(folder.path(), &pictures.expect("a chart")).expect("kept");
    let page =
        std::fs::read_to_string(report::write(folder.path(), &results).expect("a page")).expect("readable");
    assert!(page.contains("multi_exposure_still") && page.contains("data:image/jpeg;base64,"));
    assert!(folder.path().join("charts/pictures_streams.png").is_file());
    // The page is the same if it is written again from the files.
    assert_eq!(
        page,
        std::fs::read_to_string(report::write(folder.path(), &results).expect("a page")).expect("readable")
    );
}

#[test]
fn frames_that_do_not_follow_each_other_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = Data::Kitti { folder: folder.path().to_owned(), list: None };
    let why = results(&request(data, &[Stream::MultiExposure], folder.path())).expect_err("refused");
    assert!(why.to_string().contains("multi_exposure_still"), "{why}");
}

/// A picture in linear light, through camera and unwrapping: the recovered image is the ideal one, and the picture.
#[test]
fn a_picture_returns_from_linear_light() {
    let folder = tempfile::tempdir().expect("a folder");
    let picture =
        Array3::from_shape_fn((64, 256, 3), |(i, j, _)| if i < 32 { j as u8 } else { 255 - j as u8 });
    let path = folder.path().join("picture.png");
    save_png(&path, &Frame::from_u8(picture.clone()).expect("a frame")).expect("a PNG");
    let source = path.to_str().expect("UTF-8");
    let pairs = [("source", source), ("bits", "12"), ("transfer", "srgb"), ("optical_black", "0")];
    let timer = ManualClock::default();
    let topics = ["/ideal", "/recovered"].map(str::to_owned).to_vec();
    let mut chain = Lockstep::new(&timer, topics.clone());
    let name = |name| NodeName::new(name, "/", &[]).expect("a name");
    let camera = CameraParameters::from_text(&pairs).expect("possible");
    chain.add(Box::new(ModuloCamera::new(&camera).expect("a camera")), &name("camera")).expect("a node");
    let unwrap = UnwrapNode::new(&UnwrapParameters::default()).expect("a node");
    chain.add(Box::new(unwrap), &name("unwrap")).expect("a node");
    let out = chain.tick(0, 0).expect("no failure").expect("a frame");
    let [ideal, recovered] = [0, 1].map(|topic: usize| {
        let found = out.iter().find(|(name, _)| *name == topics[topic]).map(|(_, message)| message);
        let Some(Message::Image(image)) = found else { panic!("an image is expected: {out:?}") };
        image.frame.as_u8().expect("8 bits").clone()
    });
    assert_eq!(recovered, ideal);
    // Away from the edge between the two halves, which the lens blurs.
    for ((i, j, c), code) in picture.indexed_iter().filter(|((i, ..), _)| *i < 24 || *i > 40) {
        let shown = recovered[(i, j, c)];
        assert!(shown.abs_diff(*code) <= 2, "({i}, {j}): {code} is shown as {shown}");
    }
}

/// Writes a KITTI folder of `frames` images. All pixels, and the x of an object, have the value `seed`, `seed` + 8, ...
fn write_kitti(folder: &Path, frames: u8, seed: u8) {
    for name in ["image_2", "label_2"] {
        std::fs::create_dir_all(folder.join(name)).expect("a folder");
    }
    for value in (0..frames).map(|number| seed + 8 * number) {
        let frame = Frame::from_u8(Array3::from_elem((64, 200, 3), value)).expect("a frame");
        save_png(&folder.join(format!("image_2/{value:06}.png")), &frame).expect("a PNG");
        let label = format!("Car 0.00 0 0.00 {value}.00 0.00 190.00 60.00 1 1 1 0 0 0 0\n");
        std::fs::write(folder.join(format!("label_2/{value:06}.txt")), label).expect("a label");
    }
}

/// Evaluates a camera at rate 0 over each of `sources`, and records into `bag`.
fn record(sources: &[&Path], more: &[(&str, &str)], bag: &Path) {
    let mut evaluation = Evaluation::new(Difficulty::Moderate);
    let topics = ["/ideal", "/ground_truth"].map(str::to_owned).to_vec();
    let camera = CameraPlan {
        name: "/camera".to_owned(),
        member: 0,
        interval: Duration::from_millis(100),
        truth: Some(topics[1].clone()),
        streams: Vec::new(),
    };
    let plan = EvaluationPlan { cameras: vec![camera], bagged: topics.clone() };
    let recorder = BagWriter::create(bag, Compression::None).expect("a new bag");
    let mut recordings = Recordings::new(&bag.with_extension("out"), Some(recorder), None, false);
    for source in sources {
        let source = source.to_str().expect("UTF-8");
        let pairs = [&[("source", source), ("rate", "0"), ("optical_black", "0")], more].concat();
        let parameters = CameraParameters::from_text(&pairs).expect("possible");
        let timer = ManualClock::default();
        let mut chain = Lockstep::new(&timer, topics.clone());
        let camera = ModuloCamera::new(&parameters).expect("a camera");
        chain.add(Box::new(camera), &NodeName::new("camera", "/", &[]).expect("a name")).expect("a node");
        evaluation
            .add(&mut chain, &plan, &mut recordings, &|_| ControlFlow::Continue(()))
            .expect("evaluated");
    }
    recordings.finish().expect("finished");
}

/// Checks that the images of `bag` are those of `expected`, in this order, at strictly increasing times, each with its
/// own object.
fn check(bag: &Path, expected: &[u8]) {
    let reader = BagReader::open(bag).expect("a bag");
    for topic in ["/ideal", "/ground_truth"] {
        let messages = reader.messages(&Selection::of([topic]));
        let times: Vec<u64> = messages.map(|message| message.expect("readable").log_time).collect();
        assert_eq!(times.len(), expected.len(), "{topic}");
        assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "{topic}: {times:?}");
    }
    let options = SourceOptions { topic: Some("/ideal".into()), ..SourceOptions::default() };
    let mut source = open(bag.to_str().expect("UTF-8"), &options).expect("a source");
    let frames = std::iter::from_fn(|| source.next()).map(|frame| frame.expect("whole"));
    let found: Vec<(u8, f32)> = frames
        .map(|frame| {
            let truth: Vec<GroundTruth> = frame.ground_truth.expect("labelled");
            let [object] = &truth[..] else { panic!("one object: {truth:?}") };
            ((frame.radiance[[0, 0, 0]] * 255.0).round() as u8, object.bbox.x1)
        })
        .collect();
    let objects: Vec<f32> = expected.iter().map(|value| f32::from(*value)).collect();
    assert_eq!(found.iter().map(|(_, x1)| *x1).collect::<Vec<_>>(), objects, "{found:?}");
    let pixels: Vec<u8> = found.iter().map(|(pixel, _)| *pixel).collect();
    assert!(
        pixels.windows(2).zip(expected.windows(2)).all(|(a, b)| a[0].cmp(&a[1]) == b[0].cmp(&b[1])),
        "{pixels:?}"
    );
}

#[test]
fn sources_without_stamps_follow_each_other() {
    let folder = tempfile::tempdir().expect("a folder");
    let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
    write_kitti(&a, 3, 10);
    write_kitti(&b, 2, 60);
    let bag = folder.path().join("bag");
    record(&[&a, &b], &[], &bag);
    check(&bag, &[10, 18, 26, 60, 68]);
    let looped = folder.path().join("looped");
    record(&[&b, &a], &[("loop", "true"), ("frames", "4")], &looped);
    check(&looped, &[60, 68, 60, 68, 10, 18, 26, 10]);
}

/// Both recordings start at the same time stamp.
#[test]
fn sources_with_the_same_stamps_follow_each_other() {
    let folder = tempfile::tempdir().expect("a folder");
    let bags = [("a", 10), ("b", 60)].map(|(name, seed)| {
        let (kitti, bag) = (folder.path().join(name), folder.path().join(format!("{name}_bag")));
        write_kitti(&kitti, 2, seed);
        record(&[&kitti], &[], &bag);
        bag
    });
    let bag = folder.path().join("bag");
    record(&[&bags[0], &bags[1]], &[("loop", "true"), ("frames", "3")], &bag);
    check(&bag, &[10, 18, 10, 60, 68, 60]);
    // A plain copy of both bags is refused, because it has two labels with one stamp.
    let error = both(&bags, &folder.path().join("both"));
    assert!(error.contains("other labels") && error.contains("/ground_truth"), "{error}");
}

/// Copies the messages of all `bags` into one, and opens it.
fn both(bags: &[std::path::PathBuf], out: &Path) -> String {
    let mut recorder = BagWriter::create(out, Compression::None).expect("a new bag");
    for bag in bags {
        for message in BagReader::open(bag).expect("a bag").messages(&Selection::default()) {
            let message = message.expect("readable");
            let (log_time, publish_time) = (message.log_time, message.publish_time);
            recorder.record(&message.topic, log_time, publish_time, &message.data).expect("written");
        }
    }
    recorder.finish().expect("finished");
    open(out.to_str().expect("UTF-8"), &SourceOptions::default()).err().expect("refused").to_string()
}
