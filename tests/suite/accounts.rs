//! Frames that a crash takes are counted and named, and change the exit code; frames that a live run replaces are only
//! counted; a swap takes no frame.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

use modulo_middleware::transport::{Publisher as _, Transport};
use modulo_runtime::{Clock, Message, MessageKind, Qos, SystemClock};

use crate::harness::{Background, Bench, Heard, Peer, assert_has, borrowed, json, model, signal, wait_until};
use modulo_core::Frame;
use modulo_msgs::cdr;
use modulo_msgs::image::encode_frame;
use modulo_msgs::sensor_msgs::Image;
use modulo_msgs::std_msgs::{Header, Time};
use ndarray::Array3;
use serde_json::Value;

/// The nodes of a run.
const NODES: [&str; 3] = ["detector", "unwrap", "modulo_camera"];

/// The suite with the small model on the pictures of the test.
const RECOVERED: &str = "launch launch/recovered.launch.yaml source:=@/images model:=% engine:=rten \
                         --summary @/summary.json";

/// All three nodes at 10 Hz without end; the summary goes to `summary.json`.
fn suite(bench: &Bench, more: &str) -> Background {
    bench.images(4);
    bench.starts(&format!("{RECOVERED} rate:=10 loop:=true {more}"))
}

fn stamp(message: &Message) -> u64 {
    match message {
        Message::Detections(array) => array.header.stamp.as_ns(),
        Message::Image(image) => image.header.stamp.as_ns(),
        other => panic!("no stamp in {other:?}"),
    }
}

/// Waits for the answer to a frame that was made from now on.
fn next_answer(heard: &Heard, what: &str) {
    let now = SystemClock::default().now_ns();
    heard.until(what, |message| stamp(message) >= now);
}

/// Stops the process until `count` frames on its `input` were sent after that.
fn stop_for_frames(input: &Heard, count: usize, process: u32) {
    signal(process, "STOP");
    let start = SystemClock::default().now_ns();
    for _ in 0..count {
        input.until("frames in the pause", |frame| stamp(frame) >= start);
    }
}

fn part(account: &Value, part: &str) -> u64 {
    account[part].as_u64().expect("a count")
}

/// The accounts of what `node` has read, whose parts are all that was sent.
fn accounts<'a>(summary: &'a Value, node: &str) -> impl Iterator<Item = &'a Value> {
    let node = format!("/{}", node.trim_start_matches('/'));
    let accounts = summary["readers"].as_array().expect("a list").iter();
    accounts.filter(move |account| account["node"] == *node).inspect(|account| {
        let parts = ["received", "lost", "before", "down", "elsewhere", "after"];
        let sum: u64 = parts.iter().map(|name| part(account, name)).sum();
        assert_eq!(part(account, "sent"), sum, "{account}");
    })
}

/// The sum of `field` over the topics that carry the frames.
fn sum(summary: &Value, field: &str) -> u64 {
    let of = |topic| summary["topics"][topic][field].as_u64().expect("a count");
    of("/modulo") + of("/recovered")
}

/// `MODULO_CRASH_ROUNDS` is how often each node is killed; once if it is not set.
#[test]
fn every_frame_is_answered_or_counted_when_nodes_are_killed() {
    let rounds = std::env::var("MODULO_CRASH_ROUNDS").map_or(1, |text| text.parse().expect("a number"));
    let bench = Bench::new();
    // Many rounds crash a node more often than a run usually takes.
    let running = suite(&bench, "--max-restarts 0");
    let peer = Peer::new(&bench);
    wait_until("the camera", || peer.transport.is_ready("/modulo_camera"));
    let detections = peer.hear("/detector/detections", MessageKind::Detections);
    let [modulo, recovered] = ["/modulo", "/recovered"].map(|topic| peer.hear(topic, MessageKind::Image));
    for round in 1..=rounds {
        for (kind, input) in
            [("detector", Some(&recovered)), ("unwrap", Some(&modulo)), ("modulo_camera", None)]
        {
            next_answer(&detections, "boxes before the crash");
            let victim = running.node(kind).expect("it runs");
            let others = || NODES.map(|node| running.node(node).filter(|pid| *pid != victim));
            let before = others();
            if let Some(input) = input {
                // It dies with frames in its hands.
                stop_for_frames(input, 4, victim);
            }
            signal(victim, "KILL");
            let crashed = Instant::now();
            next_answer(&detections, "boxes after the crash");
            // Shown and not held to a limit, since it depends on the load of the machine.
            println!("round {round}: {kind} is back after {:?}", crashed.elapsed());
            let kept =
                others().into_iter().zip(before).filter(|(now, before)| before.is_some() && now == before);
            assert_eq!(kept.count(), 2, "the other nodes go on");
        }
    }
    assert_eq!(running.interrupt(), Some(3), "frames were lost");
    let summary = bench.json("summary.json");
    for kind in NODES {
        assert_eq!(summary["restarts"][kind], rounds, "{summary}");
    }
    let lost = |node: &str| accounts(&summary, node).map(|account| part(account, "down")).sum::<u64>();
    assert!(lost("/unwrap") >= rounds && lost("/detector") >= rounds, "{summary}");
    let answered = summary["topics"]["/detector/detections"]["out"].as_u64().expect("a count");
    let counted = sum(&summary, "dropped") + sum(&summary, "bad") + lost("/unwrap") + lost("/detector");
    assert_eq!(summary["frames"], answered + counted, "{summary}");
}

/// A reader that stands still for some frames gets the newest image then.
#[test]
fn a_replaced_image_is_a_loss_only_when_that_is_asked_for() {
    for (more, code) in [("", 0), ("--strict", 3)] {
        let bench = Bench::new();
        let running = suite(&bench, more);
        let peer = Peer::new(&bench);
        wait_until("the camera", || peer.transport.is_ready("/modulo_camera"));
        let frames = peer.hear("/modulo", MessageKind::Image);
        let detections = peer.hear("/detector/detections", MessageKind::Detections);
        next_answer(&detections, "boxes before the pause");
        let reader = running.node("unwrap").expect("it runs");
        // Many come at once after the pause, far faster than they are unwrapped.
        stop_for_frames(&frames, 12, reader);
        signal(reader, "CONT");
        next_answer(&detections, "boxes after the pause");
        assert_eq!(running.interrupt(), Some(code), "{more:?}");
        let summary = bench.json("summary.json");
        assert!(summary["topics"]["/modulo"]["replaced"].as_u64() >= Some(2), "{summary}");
        assert!(NODES.iter().all(|node| accounts(&summary, node).all(|account| part(account, "down") == 0)));
    }
}

#[test]
fn an_unreadable_image_is_skipped_and_counted() {
    let bench = Bench::new();
    std::fs::write(bench.images(5).join("000002.png"), "no picture").expect("writable");
    bench.says(3, RECOVERED);
    let (summary, topics) = (bench.json("summary.json"), &bench.json("summary.json")["topics"]);
    let counts = [&summary["frames"], &topics["source"]["bad"], &topics["/detector/detections"]["out"]];
    assert_eq!(counts.map(Value::as_u64), [4, 1, 4].map(Some), "{summary}");
}

/// An image of 8 bits with this stamp, in seconds.
fn image(sec: i32, height: usize) -> Image {
    let frame = Frame::from_u8(Array3::zeros((height, 96, 3))).expect("a frame");
    let header = Header { stamp: Time { sec, nanosec: 0 }, frame_id: "camera".into() };
    cdr::from_slice(&encode_frame(&header, &frame).expect("short")).expect("an image")
}

/// Images that no node can use, each with the name of its fault.
fn sick_images() -> Vec<(&'static str, Vec<u8>)> {
    let bytes = |change: fn(&mut Image)| {
        let mut image = image(1, 64);
        change(&mut image);
        cdr::to_vec(&image).expect("encodes")
    };
    let endless =
        |image: &mut Image| (image.height, image.width, image.step) = (u32::MAX, u32::MAX, u32::MAX);
    let not_a_number = |image: &mut Image| {
        image.encoding = "32FC3".into();
        image.width /= 4;
        image.data.fill(0xff);
    };
    vec![
        ("empty", vec![]),
        ("cut", bytes(|_| ())[..200].to_vec()),
        ("unknown encoding", bytes(|image| image.encoding = "yuv411".into())),
        ("wrong height", bytes(|image| image.height += 1)),
        ("rows that overlap", bytes(|image| image.step = 1)),
        ("no pixel", bytes(|image| (image.height, image.width) = (0, 0))),
        ("largest size", bytes(endless)),
        ("NaN", bytes(not_a_number)),
    ]
}

/// Sick publishers: images that cannot be used, stamps that go back, sizes that change, a flood. Each image is answered or
/// counted, and no node ends.
#[test]
fn images_of_sick_publishers_are_answered_or_counted() {
    let bench = Bench::new();
    let reports = bench.path("reports");
    std::fs::create_dir(&reports).expect("a writable folder");
    let start = |arguments: &[&str]| {
        let mut node = bench.modulo(&[&["run"], arguments].concat());
        node.env("MODULO_REPORT_DIR", &reports)
            .env("RUST_LOG", "error")
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        Background(node.spawn().expect("the binary starts"))
    };
    let model = format!("model:={}", model());
    let unwrap = start(&["unwrap", "--ros-args", "-p", "bits:=8", "-p", "alpha:=4.0"]);
    let detector = start(&["detector", "--ros-args", "-p", &model, "-p", "engine:=rten"]);
    let peer = Peer::new(&bench);
    let images = peer.advertise_raw("/modulo", MessageKind::Image);
    let answers = peer.hear("/detector/detections", MessageKind::Detections);
    wait_until("the nodes", || ["/unwrap", "/detector"].iter().all(|node| peer.transport.is_ready(node)));
    wait_until("the reader", || images.wanted());

    let answer_to = |sec: i32, what: &str| {
        answers.until(what, |message| {
            // The sick images have the stamp 1 s.
            assert_ne!(stamp(message), 1_000_000_000, "{what} was answered");
            stamp(message) == u64::try_from(sec).expect("positive") * 1_000_000_000
        });
    };
    let send = |image: &Image| images.put(cdr::to_vec(image).expect("encodes")).expect("it is sent");
    // Each node is ready, but unwrap may not know of the detector yet.
    let first = (0..).find(|number| {
        send(&image(400 + number, 64));
        answers.next(Duration::from_millis(500)).is_some()
    });
    let sick = sick_images();
    for (sec, (name, bytes)) in (100..).zip(&sick) {
        images.put(bytes.clone()).expect("it is sent");
        // The stamps go back, and each image has another size.
        let sec = 300 - sec;
        send(&image(sec, 300 - sec as usize));
        answer_to(sec, name);
    }
    // The last one of the sick images, since a good image after it may replace it before the node has read it.
    let report = || json(&reports.join("unwrap.1.json"));
    images.put(sick[0].1.clone()).expect("it is sent");
    wait_until("a sick image", || report()["bad"]["/modulo"].as_u64() > Some(0));
    let flood = 500;
    (0..flood).for_each(|number| send(&image(1000 + number, 64)));
    // The last one of a burst may get lost on the way, but then the next one comes.
    let last = (0..).find(|number| {
        send(&image(2000 + number, 64));
        answers.next(Duration::from_millis(500)).is_some_and(|message| stamp(&message) >= 2_000_000_000_000)
    });
    let first = first.expect("an answer") as u64 + 1;
    let sent = first + 2 * sick.len() as u64 + 1 + flood as u64 + last.expect("an answer") as u64 + 1;
    for node in [unwrap, detector] {
        assert_eq!(node.interrupt(), Some(0));
    }

    let report = report();
    let count = |field: &str, topic: &str| report[field][topic].as_u64().unwrap_or_default();
    assert!((1..=sick.len() as u64 + 1).contains(&count("bad", "/modulo")), "{report}");
    assert_eq!(count("received", "/modulo") + count("lost", "/modulo"), sent, "{report}");
    let answered = count("published", "/recovered") + count("unwanted", "/recovered");
    let rest = ["replaced", "bad", "unread"].map(|field| count(field, "/modulo"));
    assert_eq!(answered + rest.iter().sum::<u64>(), count("received", "/modulo"), "{report}");
}

/// `modulo launch FILE | head` ended with a panic and without the summary's file.
#[test]
fn a_closed_pipe_costs_neither_the_exit_code_nor_the_summary() {
    let bench = Bench::new();
    bench.images(2);
    for way in ["", " --compose"] {
        let words = bench.words(&format!("{RECOVERED}{way}"));
        let mut child = bench.modulo(&borrowed(&words));
        let mut child = child.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
        drop((child.stdout.take(), child.stderr.take()));
        assert_eq!(child.wait().expect("it ends").code(), Some(0), "{way}");
        assert_eq!(bench.json("summary.json")["frames"], 2, "{way}");
        std::fs::remove_file(bench.path("summary.json")).expect("there");
    }
}

/// A detector and what it publishes, in a suite whose camera shows one image again and again at rate 0.
struct Swapped {
    running: Background,
    peer: Peer,
    detections: Heard,
    heard: Vec<Message>,
    state: Heard,
    states: RefCell<Vec<Message>>,
}

fn in_use<'a>(state: &'a Message, key: &str) -> &'a str {
    let Message::Diagnostics(array) = state else { panic!("no state: {state:?}") };
    let value = array.status[0].values.iter().find(|value| value.key == key);
    value.map_or("", |value| value.value.as_str())
}

impl Swapped {
    fn start(bench: &Bench) -> Self {
        let peer = Peer::new(bench);
        let detections = peer.hear("/detector/detections", MessageKind::Detections);
        let state = peer.hear_as("/detector/state", MessageKind::Diagnostics, Qos::Latched);
        bench.images(1);
        let running = bench.starts(&format!("{RECOVERED} loop:=true score_threshold:=0.0"));
        next_answer(&detections, "boxes");
        Self { running, peer, detections, heard: Vec::new(), state, states: RefCell::default() }
    }

    /// Sets a parameter of the detector, and waits until `key` of its state has the value `wanted`.
    fn swap(&mut self, name: &str, value: &str, key: &str, wanted: &str) {
        self.peer.set("/detector", name, value).expect("possible");
        self.wait_for(key, wanted);
        self.heard.extend(std::iter::from_fn(|| self.detections.next(Duration::ZERO)));
    }

    fn wait_for(&self, key: &str, wanted: &str) {
        self.state.until(wanted, |state| {
            self.states.borrow_mut().push(state.clone());
            in_use(state, key) == wanted
        });
    }

    /// Ends the camera behind its last frame. Returns each answer with the state that it came in; every frame has one
    /// answer.
    fn end(mut self, bench: &Bench) -> Vec<(Message, Message)> {
        // It has sent more frames than one, and so it ends when the last one is answered.
        self.peer.set("/modulo_camera", "frames", "1").expect("possible");
        assert_eq!(self.running.0.wait().expect("it ends").code(), Some(0));
        let summary = bench.json("summary.json");
        assert_eq!(summary["frames"], summary["topics"]["/detector/detections"]["out"], "{summary}");
        self.heard.extend(std::iter::from_fn(|| self.detections.next(Duration::ZERO)));
        self.states.borrow_mut().extend(std::iter::from_fn(|| self.state.next(Duration::ZERO)));
        assert!(self.heard.is_sorted_by(|a, b| stamp(a) < stamp(b)), "no frame is answered twice");
        let states = self.states.into_inner();
        let of = |answer: &Message| {
            let state = states.iter().rfind(|state| state.stamp().as_ns() <= stamp(answer));
            state.expect("the state comes before the first answer").clone()
        };
        self.heard.into_iter().map(|answer| (of(&answer), answer)).collect()
    }
}

/// Class and score of the box of the small model that has one of these classes.
fn found(answer: &Message, classes: &[&str]) -> (String, String) {
    let Message::Detections(array) = answer else { panic!("no boxes: {answer:?}") };
    let mut found = array.detections.iter().map(|detection| &detection.results[0].hypothesis);
    let found = found.find(|found| classes.contains(&found.class_id.as_str())).expect("one of its boxes");
    (found.class_id.clone(), format!("{:.6}", found.score))
}

/// `MODULO_SWAP_ROUNDS` is the number of swaps; 100 if it is not set. The small model shows the mean of its image, so
/// that each answer tells from which stream it really came.
#[test]
fn every_frame_is_answered_once_while_the_input_is_swapped() {
    let rounds = std::env::var("MODULO_SWAP_ROUNDS").map_or(100, |text| text.parse().expect("a number"));
    let bench = Bench::new();
    let mut run = Swapped::start(&bench);
    for round in 0..rounds {
        let input = ["modulo", "saturated", "recovered"][round % 3];
        run.swap("input", input, "stream", input);
    }
    let why = run.peer.set("/detector", "input", "recoverd").expect_err("no stream");
    assert!(why.contains("recoverd") && why.contains("saturated"), "{why}");
    let mut means: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (state, answer) in run.end(&bench) {
        means.entry(in_use(&state, "stream").to_owned()).or_default().insert(found(&answer, &["7"]).1);
    }
    let counted = &bench.json("summary.json")["detections"];
    assert!(means.keys().all(|stream| counted[stream]["car"].as_u64() > Some(3)), "{counted}");
    assert_eq!(means.keys().collect::<Vec<_>>(), ["modulo", "recovered", "saturated"]);
    let all: BTreeSet<_> = means.values().flatten().collect();
    assert!(means.values().all(|means| means.len() == 1) && all.len() == 3, "{means:?}");
}

/// One of the two models has no names for its classes, so that each answer tells from which model it really came.
#[test]
fn every_frame_is_answered_once_while_the_model_is_swapped() {
    let bench = Bench::new();
    let mut run = Swapped::start(&bench);
    for round in 0..10 {
        let file = ["nameless.onnx", "rows.onnx"][round % 2];
        let model = Path::new(&model()).with_file_name(file).display().to_string();
        run.swap("model", &model, "model", file);
    }
    let why = run.peer.set("/detector", "model", "/no/such.onnx");
    assert!(why.as_ref().is_err_and(|why| why.contains("'model' = /no/such.onnx")), "{why:?}");
    let why = run.peer.set("/detector", "classes", "[zebra]");
    assert!(
        why.as_ref().is_err_and(|why| why.contains("person, bicycle, car")),
        "the model is kept: {why:?}"
    );
    assert_has(&bench.says(0, "param get /detector model"), &["rows.onnx"]);
    run.swap("threads", "3", "threads", "3");
    next_answer(&run.detections, "boxes after all swaps");
    let mut classes = BTreeSet::new();
    for (state, answer) in run.end(&bench) {
        classes.insert((in_use(&state, "model").to_owned(), found(&answer, &["0", "person"]).0));
    }
    let expected = [("nameless.onnx", "0"), ("rows.onnx", "person")];
    assert_eq!(classes, expected.map(|(model, class)| (model.into(), class.into())).into());
}

/// Settings of the other nodes, a source of frames, and a source that is a topic.
#[test]
fn every_frame_is_answered_once_while_other_settings_are_swapped() {
    let bench = Bench::new();
    let run = Swapped::start(&bench);
    let states = ["/unwrap", "/modulo_camera"].map(|node| {
        (node, run.peer.hear_as(&format!("{node}/state"), MessageKind::Diagnostics, Qos::Latched))
    });
    let picture = bench.path("images").join("000000.png").display().to_string();
    let camera = "/modulo_camera";
    for (node, name, value) in [
        ("/unwrap", "method", "tree"),
        ("/unwrap", "deblur", "true"),
        (camera, "alpha", "2.0"),
        (camera, "bits", "10"),
        (camera, "psf_sigma", "0.5"),
        (camera, "source", &picture),
    ] {
        run.peer.set(node, name, value).expect("possible");
        // What the camera uses reaches the unwrapping with the frame.
        for (of, state) in &states {
            if *of == node || ["alpha", "bits", "psf_sigma"].contains(&name) {
                state.until(name, |state| in_use(state, name) == value);
            }
        }
    }
    let why = run.peer.set(camera, "source", "/no/such");
    assert!(why.as_ref().is_err_and(|why| why.contains("'source' = /no/such")), "{why:?}");
    // A source that waits for a topic, and then a file again.
    run.peer.set(camera, "source", "topic:/none").expect("possible");
    wait_until("the camera reads the topic", || !run.peer.subscribers("/none").is_empty());
    run.peer.set(camera, "source", &picture).expect("possible");
    next_answer(&run.detections, "boxes after all swaps");
    run.end(&bench);
}

/// One detector reads two cameras. A change of the input that is none for a camera takes no frame of it: each image of both
/// cameras has one answer, or was replaced by a newer one.
#[test]
fn every_frame_of_two_cameras_is_answered_once_while_the_input_is_swapped() {
    let bench = Bench::new();
    let [front, rear] = [("front", "tunnel"), ("rear", "glare")]
        .map(|(camera, scene)| format!("{camera}:=scene://{scene}?seed=1&width=96&height=64&frames=1000000"));
    let detector = "shared:=true input:=auto rate:=20.0 engine:=rten model:=% --summary @/summary.json";
    let running = bench.starts(&format!("launch launch/cameras.launch.yaml {detector} {front} {rear}"));
    let peer = Peer::new(&bench);
    let heard = ["front", "rear"]
        .map(|camera| peer.hear(&format!("/detector/{camera}/detections"), MessageKind::Detections));
    let next = || heard.iter().for_each(|camera| next_answer(camera, "boxes of each camera"));
    next();
    for round in 0..12 {
        peer.set("/detector", "input", ["metered", "auto"][round % 2]).expect("possible");
        next();
    }
    assert_eq!(running.interrupt(), Some(0));
    let summary = bench.json("summary.json");
    for camera in ["front", "rear"] {
        let image = &summary["topics"][format!("/{camera}/metered")];
        let answered = summary["topics"][format!("/detector/{camera}/detections")]["out"].as_u64();
        let [sent, replaced] = ["out", "replaced"].map(|field| image[field].as_u64().expect("a count"));
        assert_eq!(answered, Some(sent - replaced), "{camera}: {summary}");
    }
    let streams: Vec<_> = summary["detections"].as_object().expect("by stream").keys().collect();
    assert_eq!(streams, ["/front/metered", "/rear/metered"]);
}
