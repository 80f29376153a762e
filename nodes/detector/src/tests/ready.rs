//! A detector is ready when it has run at the size that it will get, and no frame waits for a search: tests with an engine that searches at
//! the first run of each size, as one on a GPU does.

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use modulo_core::{Detection, Frame};
use modulo_middleware::driver::CommonParameters;
use modulo_middleware::driver::live::{self, NodeSetup};
use modulo_middleware::transport::{
    Claim, Guard, Incoming, ParameterAnswer, ParameterPort, ParameterRequest, Transport as _,
};
use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::{
    Address, Clock, Context, Flow, Message, MessageKind, Node, NodeName, NodeReport, ParameterError,
    ParameterSet as _, Parameters, SensorModel, StampedFrame, StepError, Stop, SystemClock, Topic, Trigger,
    Urgency, Value, sensor_info,
};
use ndarray::{Array2, Array3, ArrayView4, s};

use crate::engine::{Engine, OpenedEngine, SharedEngine};
use crate::model::ModelLayout;
use crate::names::ClassNames;
use crate::{Detector, DetectorParameters, EngineError, Sessions};

#[path = "../../../../tests/harness/offered.rs"]
mod offered;

use offered::Offered;

type Size = (usize, usize);

/// A model of a test, which counts how often it was loaded and at which sizes it has run.
struct Model {
    path: PathBuf,
    search: Duration,
    /// How often it was loaded.
    sessions: Mutex<usize>,
    /// The first run at each size of each session, and whether it was beside the steps of a live node.
    searches: Mutex<Vec<(Size, bool)>>,
    /// The size of the last run that was not the first one at its size.
    last: Mutex<Size>,
}

static MODELS: Mutex<BTreeMap<PathBuf, Arc<Model>>> = Mutex::new(BTreeMap::new());

fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Model {
    /// A model of this name whose first run at each size takes so long.
    fn new(name: &str, search: Duration) -> Arc<Self> {
        let path = Path::new("/searching").join(name);
        let (sessions, searches, last) = Default::default();
        let model = Arc::new(Self { path: path.clone(), search, sessions, searches, last });
        lock(&MODELS).insert(path, model.clone());
        model
    }

    /// The sizes of all first runs.
    fn sizes(&self) -> Vec<Size> {
        lock(&self.searches).iter().map(|(size, _)| *size).collect()
    }

    fn parameters(&self, changes: &[(&str, &str)]) -> Parameters {
        let model = self.path.to_str().expect("a text");
        let declared = [DetectorParameters::descriptors(), CommonParameters::descriptors()].concat();
        let all = [&[("model", model)], changes].concat();
        Parameters::declare(declared).with_text(&all).expect("possible")
    }
}

/// Returns an engine for a model of a test.
pub fn searching(model: &Path) -> Option<OpenedEngine> {
    let model = lock(&MODELS).get(model)?.clone();
    *lock(&model.sessions) += 1;
    let names = ClassNames::of(&model.path, Some("{0: 'light'}")).expect("names");
    let (input, output) = ("images".to_owned(), "output0".to_owned());
    let layout = ModelLayout { input, output, size: None, stride: 32, names, end_to_end: Some(true) };
    let engine = SharedEngine::new(Searching { model, known: BTreeSet::new() });
    let (name, threads, note) = ("ort", NonZeroUsize::MIN, "a test".to_owned());
    Some(OpenedEngine { engine, name, threads, layout, note, searches: true })
}

/// Finds the bright rectangle in its input.
struct Searching {
    model: Arc<Model>,
    known: BTreeSet<Size>,
}

impl Engine for Searching {
    fn run(&mut self, input: ArrayView4<'_, f32>) -> Result<Array2<f32>, EngineError> {
        let (_, _, height, width) = input.dim();
        if self.known.insert((height, width)) {
            let beside = std::thread::current().name() == Some("parts");
            lock(&self.model.searches).push(((height, width), beside));
            std::thread::sleep(self.model.search);
        } else {
            *lock(&self.model.last) = (height, width);
        }
        let red = input.slice(s![0, 0, .., ..]);
        let bright = red.indexed_iter().filter(|(_, value)| **value > 0.9);
        let (mut from, mut to) = ([f32::MAX; 2], [0.0f32; 2]);
        for ((y, x), _) in bright {
            from = [from[0].min(x as f32), from[1].min(y as f32)];
            to = [to[0].max(x as f32 + 1.0), to[1].max(y as f32 + 1.0)];
        }
        let score = if to[0] > 0.0 { 0.9 } else { 0.0 };
        Ok(ndarray::array![[from[0], from[1], to[0], to[1], score, 0.0]])
    }
}

/// An image with a bright rectangle in the second quarter of its rows and columns.
fn image((height, width): Size) -> Frame {
    let is_bright = |y, x| (height / 4..height / 2).contains(&y) && (width / 4..width / 2).contains(&x);
    let pixels = Array3::from_shape_fn((height, width, 3), |(y, x, _)| if is_bright(y, x) { 255 } else { 0 });
    Frame::from_u8(pixels).expect("a frame")
}

/// Returns whether this rectangle was found, a few pixels more or less where the image was resized.
fn is_found(found: &[Detection], (height, width): Size) -> bool {
    let [Detection { bbox, .. }] = found else { return false };
    let (height, width) = (height as f32, width as f32);
    let sides = [bbox.x1 / width, bbox.y1 / height, bbox.x2 / width, bbox.y2 / height];
    sides.iter().zip([0.25, 0.25, 0.5, 0.5]).all(|(side, expected)| (side - expected).abs() < 0.03)
}

/// The description of the frame of `size` with this stamp.
fn described(stamp: Time, size: Size) -> Message {
    let header = Header { stamp, frame_id: "camera".into() };
    sensor_info::message((&header, size), &SensorModel::default(), "/camera", [])
}

const RATE: u64 = 30;
const PERIOD: Duration = Duration::from_nanos(1_000_000_000 / RATE);

/// A camera of 30 Hz.
#[derive(Clone)]
struct Camera {
    /// The size of its next images.
    size: Arc<Mutex<Size>>,
    /// Number of frames that it still sends.
    frames: Arc<Mutex<u64>>,
    /// Stamp of its first frame, ns.
    first: Arc<Mutex<Option<u64>>>,
}

impl Camera {
    fn new(size: Size, frames: u64) -> Self {
        let (size, frames) = (Arc::new(Mutex::new(size)), Arc::new(Mutex::new(frames)));
        Self { size, frames, first: Arc::default() }
    }
}

impl Node for Camera {
    fn inputs(&self) -> Vec<Topic> {
        Vec::new()
    }

    fn outputs(&self) -> Vec<Topic> {
        vec![Topic::new("recovered", MessageKind::Image), sensor_info::topic()]
    }

    fn period(&self) -> Option<Duration> {
        Some(PERIOD)
    }

    fn configure(&mut self, _: &Parameters) -> Result<(), ParameterError> {
        Ok(())
    }

    fn introduce(&mut self, cx: &mut Context<'_>) {
        cx.emit(1, described(Time::default(), *lock(&self.size)));
    }

    fn step(&mut self, _: Trigger, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        let Some(rest) = lock(&self.frames).checked_sub(1) else { return Ok(Flow::Done) };
        *lock(&self.frames) = rest;
        let (stamp, size) = (Time::from_ns(cx.now_ns()), *lock(&self.size));
        lock(&self.first).get_or_insert(stamp.as_ns());
        let header = Header { stamp, frame_id: "camera".into() };
        cx.emit(1, described(stamp, size));
        cx.emit(0, StampedFrame { header, frame: image(size) });
        Ok(Flow::Continue)
    }
}

fn named(name: &str) -> NodeName {
    NodeName::new(name, "/", &[]).expect("a name")
}

fn wait_until(condition: &str, mut done: impl FnMut() -> bool) {
    for _ in 0..3000 {
        if done() {
            return;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    panic!("did not happen within a minute: {condition}");
}

/// An answer: when it came, and its boxes.
#[derive(Clone)]
struct Answer {
    now: u64,
    found: Vec<Detection>,
}

/// The nodes of a test on a transport of their own.
struct Stage {
    transport: Arc<Offered>,
    ports: Receiver<ParameterPort>,
    clock: Arc<dyn Clock>,
    stop: Stop,
    answers: Arc<Mutex<Vec<Answer>>>,
    _subscription: Guard,
}

impl Stage {
    fn new() -> Self {
        let (transport, ports) = Offered::new();
        let clock: Arc<dyn Clock> = Arc::new(SystemClock::default());
        let answers = Arc::<Mutex<Vec<Answer>>>::default();
        let (heard, heard_at) = (answers.clone(), clock.clone());
        let topic = Topic::new("/detector/detections", MessageKind::Detections);
        let address = Address::resolve(&named("test"), &topic).expect("a name");
        let take = Box::new(move |incoming| {
            let Incoming::Message(Message::Detections(array)) = incoming else { panic!("no boxes") };
            let found = array.detections.iter().filter_map(|one| one.to_detection()).collect();
            lock(&heard).push(Answer { now: heard_at.now_ns(), found });
        });
        let _subscription = transport.subscribe(&named("test"), &address, take).expect("local");
        Self { transport, ports, clock, stop: Stop::default(), answers, _subscription }
    }

    fn start(
        &self,
        name: &'static str,
        make: impl FnOnce() -> Box<dyn Node> + Send + 'static,
        parameters: Parameters,
    ) -> JoinHandle<NodeReport> {
        let (transport, clock, stop) = (self.transport.clone(), self.clock.clone(), self.stop.clone());
        std::thread::spawn(move || {
            let node_name = named(name);
            let setup = NodeSetup { node: make(), parameters, node_name, saved: None, report_file: None };
            live::run(setup, &*transport, &clock, stop).expect("runs")
        })
    }

    fn detector(&self, model: &Model, changes: &[(&str, &str)]) -> JoinHandle<NodeReport> {
        let parameters = model.parameters(changes);
        let typed = DetectorParameters::from(&parameters);
        self.start("detector", move || Box::new(Detector::new(&typed).expect("a detector")), parameters)
    }

    /// Starts a camera that waits for the detector.
    fn camera(&self, camera: &Camera) -> JoinHandle<NodeReport> {
        let declared = Parameters::declare(CommonParameters::descriptors());
        let parameters = declared.with_text(&[("wait_for", "[detector]")]).expect("possible");
        let camera = camera.clone();
        self.start("camera", move || Box::new(camera), parameters)
    }

    fn answered(&self) -> usize {
        lock(&self.answers).len()
    }

    /// The longest time between two frames that were answered one after the other.
    fn longest_gap(&self) -> Duration {
        let answers = lock(&self.answers);
        let gaps = answers.windows(2).map(|pair| Duration::from_nanos(pair[1].now - pair[0].now));
        gaps.max().expect("answers")
    }

    /// Ends the detector behind a camera that has ended, and asserts that each frame is in a count.
    fn end(&self, camera: JoinHandle<NodeReport>, detector: JoinHandle<NodeReport>) {
        let camera = camera.join().expect("no panic");
        self.stop.ask(Urgency::Drain);
        let detector = detector.join().expect("no panic");
        let of = |counts: &BTreeMap<String, u64>, topic| counts.get(topic).copied().unwrap_or_default();
        let (sent, topic) = (of(&camera.published, "/recovered"), "/recovered");
        let boxes = of(&detector.published, "/detector/detections");
        assert_eq!(sent, of(&detector.received, topic), "{detector:?}");
        let others = of(&detector.replaced, topic) + of(&detector.unread, topic) + of(&detector.bad, topic);
        assert_eq!((sent, of(&detector.bad, topic)), (boxes + others, 0), "{detector:?}");
        assert_eq!(boxes as usize, self.answered());
    }
}

/// Starts a detector beside cameras that tell these sizes; returns where it has run when it is ready.
fn run_before_ready(name: &str, cameras: &[(&str, Size)], changes: &[(&str, &str)]) -> Vec<Size> {
    let (stage, model) = (Stage::new(), Model::new(name, Duration::ZERO));
    let advertise = |&(topic, size): &(&str, Size)| {
        let topic = Topic { name: topic.into(), ..sensor_info::topic() };
        let address = Address::resolve(&named("camera"), &topic).expect("a name");
        let publisher = stage.transport.advertise(&named("camera"), &address).expect("local");
        publisher.put(&described(Time::default(), size)).expect("local");
        publisher
    };
    let _publishers: Vec<_> = cameras.iter().map(advertise).collect();
    let detector = stage.detector(&model, changes);
    wait_until("the detector is ready", || stage.transport.is_ready("/detector"));
    let sizes = model.sizes();
    stage.stop.ask(Urgency::Now);
    detector.join().expect("no panic");
    assert_eq!(*lock(&model.sessions), 1, "{name}");
    sizes
}

#[test]
fn a_detector_has_run_at_the_size_that_it_will_get_before_it_is_ready() {
    let camera = [("/sensor_info", (375, 1242))];
    assert_eq!(run_before_ready("told", &camera, &[]), [(640, 640), (384, 1248)]);
    assert_eq!(run_before_ready("untold", &[], &[]), [(640, 640)], "nobody tells the size");
    let fixed = [("input_size", "320x256")];
    assert_eq!(run_before_ready("fixed", &camera, &fixed), [(256, 320)], "whatever the camera has");
    let two = [("/front/sensor_info", (96, 160)), ("/rear/sensor_info", (200, 160))];
    let both = [("cameras", "[/front, /rear]")];
    assert_eq!(run_before_ready("two", &two, &both), [(640, 640), (128, 160), (224, 160)]);
    let one = run_before_ready("one", &two[..1], &both);
    assert_eq!(one, [(640, 640), (128, 160)], "a camera that is not there is not waited for");
}

/// A camera of 30 Hz, whose first frame is answered at once although the engine searches for 2 s at each size.
#[test]
fn the_first_frame_is_as_fast_as_all_others() {
    let (stage, size) = (Stage::new(), (96, 160));
    let model = Model::new("start", Duration::from_secs(2));
    let source = Camera::new(size, 45);
    let camera = stage.camera(&source);
    let detector = stage.detector(&model, &[]);
    stage.end(camera, detector);
    assert_eq!(model.sizes(), [(640, 640), (128, 160)], "all before the first frame");
    let answers = lock(&stage.answers);
    assert!(answers.iter().all(|answer| is_found(&answer.found, size)));
    let age = Duration::from_nanos(answers[0].now - lock(&source.first).expect("a frame"));
    // 0.02 s on an idle machine. A busy one may stop a thread for longer; a search in a step would be longer still.
    assert!(age < model.search, "{age:?}");
}

/// The images of another size, and then another `input_size`: the frames are answered all the time.
#[test]
fn no_frame_waits_for_a_search_at_another_size() {
    let (stage, search) = (Stage::new(), Duration::from_secs(2));
    let (model, source) = (Model::new("change", search), Camera::new((96, 160), u64::MAX));
    let (camera, detector) = (stage.camera(&source), stage.detector(&model, &[]));
    let (of_camera, of_detector) = (stage.ports.recv(), stage.ports.recv());
    let ports = [of_camera.expect("a node"), of_detector.expect("a node")];
    let port =
        ports.into_iter().find(|port| (port.read)().get("input_size").is_some()).expect("the detector");
    wait_until("frames are answered", || stage.answered() > 10);
    assert_eq!(model.sizes(), [(640, 640), (128, 160)]);

    *lock(&source.size) = (200, 320);
    wait_until("the other size is in use", || *lock(&model.last) == (224, 320));
    // The size that the images have counts at the end, and not that of the input before.
    for (asked, expected) in [("320x256", (256, 320)), ("auto", (224, 320))] {
        let (answer, verdict) = channel();
        let changes = vec![vec![("input_size".to_owned(), Value::String(asked.into()))]];
        assert!((port.request)(ParameterRequest { changes, answer, claim: Claim::default() }));
        let verdicts: Vec<_> = verdict.iter().collect();
        assert_eq!(verdicts, [ParameterAnswer::Loading, ParameterAnswer::Done(vec![Ok(())])]);
        wait_until("the other size is in use", || *lock(&model.last) == expected);
    }
    *lock(&source.frames) = 0;
    stage.end(camera, detector);

    let searches = lock(&model.searches).clone();
    let beside: Vec<_> = searches[2..].iter().map(|(size, beside)| (*size, *beside)).collect();
    let expected = [(640, 640), (128, 160), (224, 320), (256, 320), (224, 320)];
    assert_eq!(beside, expected.map(|size| (size, true)), "no step has waited for a search");
    assert_eq!(*lock(&model.sessions), 4);
    // A period on an idle machine. A busy one may stop a thread for longer; a search in a step would be longer still.
    println!("the longest gap was {:?}", stage.longest_gap());
    assert!(stage.longest_gap() < search, "{:?}", stage.longest_gap());
    for Answer { found, .. } in lock(&stage.answers).iter() {
        assert!([(96, 160), (200, 320)].iter().any(|size| is_found(found, *size)), "{found:?}");
    }
}

/// The workers of an evaluation on a GPU share one model in this way.
#[test]
fn detectors_of_many_threads_load_and_search_once() {
    let model = Model::new("shared", Duration::from_millis(100));
    let parameters = DetectorParameters::from(&model.parameters(&[]));
    let sessions = Sessions::remembering(4);
    std::thread::scope(|scope| {
        for _ in 0..16 {
            let (sessions, parameters) = (sessions.clone(), &parameters);
            scope.spawn(move || {
                let mut detector = Detector::sharing(parameters, &sessions).expect("a detector");
                assert!(is_found(&detector.find(&image((96, 160))).expect("runs"), (96, 160)));
            });
        }
    });
    assert_eq!((*lock(&model.sessions), model.sizes()), (1, vec![(640, 640), (128, 160)]));
}
