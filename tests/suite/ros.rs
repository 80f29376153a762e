//! The suite as ROS 2 sees it: recordings and replays, parameters of running nodes, logs on `/rosout`, simulated time, late
//! readers, and peers that do not fit.

use std::cell::RefCell;
use std::path::Path;
use std::process::Stdio;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

use modulo_middleware::graph::type_description;
use modulo_middleware::transport::zenoh::RawService;
use modulo_middleware::transport::{Publisher as _, Transport};
use modulo_runtime::wire::keys::{Endpoint, EntityKind, Hashes, NO_HASH, SERVICE_QOS};
use modulo_runtime::{Message, MessageKind, Qos, StampedFrame};

use crate::harness::{Background, Bench, Peer, assert_has, signal, text, wait_until};
use modulo_bags::bag::{BagReader, Selection};
use modulo_core::Frame;
use modulo_msgs::cdr;
use modulo_msgs::rcl_interfaces::{
    GetLoggerLevelsRequest, GetLoggerLevelsResponse, Log, LoggerLevel, SetLoggerLevelsRequest,
    SetLoggerLevelsResponse,
};
use modulo_msgs::rosgraph_msgs;
use modulo_msgs::sensor_msgs::{CameraInfo, CompressedImage, Image};
use modulo_msgs::std_msgs::{Header, Time};
use modulo_msgs::type_description_interfaces::{GetTypeDescriptionResponse, TypeSource};
use modulo_msgs::vision_msgs::Detection2DArray;
use ndarray::Array3;

const DETECTOR: &str = "run detector --ros-args -p model:=% -p engine:=rten";

/// A camera that sends small images for ever.
fn camera(bench: &Bench, more: &str) -> Background {
    bench.images(3);
    let fixed = "-p source:=@/images -p loop:=true -p rate:=20";
    bench.starts(&format!("run modulo_camera --ros-args {fixed} {more}"))
}

fn log(message: Message) -> Log {
    match message {
        Message::Log(log) => Log::clone(&log),
        other => panic!("a log line, not {other:?}"),
    }
}

/// An empty domain and a misspelt name look alike to someone whose nodes speak DDS: both are told with the remedy.
#[test]
fn what_is_not_there_is_told_with_the_remedy() {
    let bench = Bench::new();
    for (command, what) in [("node", "node"), ("topic", "topic"), ("param", "node with parameters")] {
        let output = bench.run(&[command, "list"]);
        assert!(output.status.success() && output.stdout.is_empty(), "{}", text(&output));
        let told = String::from_utf8_lossy(&output.stderr);
        assert_has(
            &told,
            &[
                &format!("there is no {what} in domain"),
                "RMW_IMPLEMENTATION=rmw_zenoh_cpp",
                "dds.launch.yaml",
            ],
        );
    }
    let _unwrap = bench.start(&["run", "unwrap"]);
    let peer = Peer::new(&bench);
    wait_until("the node", || peer.transport.is_ready("/unwrap"));
    for (command, near) in [
        (vec!["topic", "echo", "--once", "/recoverd"], "'/recovered'"),
        (vec!["param", "get", "/unwarp", "alpha"], "'/unwrap'"),
        (vec!["node", "info", "/car/unwrap"], "'/unwrap'"),
    ] {
        let output = bench.run(&command);
        assert_eq!(output.status.code(), Some(1));
        let message = text(&output);
        assert_has(&message, &[&format!("did you mean {near}?")]);
        assert!(!message.contains("/peer"), "the guess stands alone: {message}");
    }
    assert!(bench.run(&["node", "list"]).stderr.is_empty());
}

/// With --json, programs can read what these commands print.
#[test]
fn the_machine_and_a_model_are_printed_as_json() {
    let bench = Bench::new();
    let asked = |line: &str| -> serde_json::Value {
        let output = bench.run(&line.split(' ').chain(["--json"]).collect::<Vec<_>>());
        serde_json::from_slice(&output.stdout).unwrap_or_else(|why| panic!("{line}: {why}"))
    };
    assert_eq!(asked("doctor")["domain"], bench.domain.id);
    assert_eq!(asked("model check demo --engine rten")["classes"][0], "car");
}

/// A camera waits for images of ROS 2 that do not come: one warning names the cause, and the nodes behind it are silent.
#[test]
fn a_topic_without_images_is_told_once() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let heard = peer.hear_as("/rosout", MessageKind::Log, Qos::Logs);
    let sensor = "-p bits:=8 -p alpha:=4.0";
    let _unwrap = bench.starts(&format!("run unwrap --ros-args {sensor}"));
    let _camera =
        bench.starts(&format!("run modulo_camera --ros-args -p source:=topic:/camera/image_raw {sensor}"));
    let warning = |message: &Message| log(message.clone()).msg.contains("no image has come on");
    let first = log(heard.until("a warning", warning));
    assert_eq!(first.name, "modulo_camera");
    assert_has(
        &first.msg,
        &["/camera/image_raw", "no node publishes it", "RMW_IMPLEMENTATION=rmw_zenoh_cpp", "dds.launch.yaml"],
    );
    let (mut more, since) = (0, Instant::now());
    while since.elapsed() < Duration::from_secs(4) {
        more += u32::from(heard.next(Duration::from_millis(100)).is_some_and(|message| warning(&message)));
    }
    assert_eq!(more, 0);
}

/// Whoever reads `/rosout` late gets what was said before.
#[test]
fn log_lines_are_on_rosout_and_outlast_their_moment() {
    let bench = Bench::new();
    let _unwrap = bench.start(&["run", "unwrap", "--ros-args", "-r", "__ns:=/car"]);
    let _quiet =
        bench.start(&["run", "unwrap", "--ros-args", "-r", "__node:=quiet", "--disable-rosout-logs"]);
    let peer = Peer::new(&bench);
    wait_until("both nodes", || peer.transport.is_ready("/car/unwrap") && peer.transport.is_ready("/quiet"));

    let heard = peer.hear("/rosout", MessageKind::Log);
    let ready = log(heard.until("the line 'ready'", |m| log(m.clone()).msg == "ready"));
    assert_eq!((ready.name.as_str(), ready.level), ("car.unwrap", Log::INFO));
    assert!(ready.stamp.sec > 0 && ready.line > 0 && ready.file.ends_with(".rs"), "{ready:?}");

    let graph = peer.transport.graph();
    let writers = graph.endpoints(EntityKind::Publisher, "/rosout");
    assert_eq!(writers.map(|token| token.node_name()).collect::<Vec<_>>(), ["/car/unwrap"]);

    // The same by the shipped reader.
    let echoed = bench.says(0, "topic echo /rosout --once");
    assert!(echoed.contains("car.unwrap"), "{echoed}");
}

#[test]
fn stamps_follow_the_clock_topic_while_use_sim_time_is_on() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let images = peer.hear("/modulo", MessageKind::Image);
    let clock = peer.advertise("/clock", MessageKind::Clock);
    let _camera = camera(&bench, "-p use_sim_time:=true");

    let first = images.until("an image", |_| true);
    assert_eq!(first.stamp(), Time::default(), "0 before the first time on /clock");

    let expected = Time { sec: 42, nanosec: 500_000_000 };
    wait_until("the camera on /clock", || clock.wanted());
    clock.put(&Message::Clock(rosgraph_msgs::Clock { clock: expected }.into())).expect("sent");
    images.until("an image of the simulated time", |image| image.stamp() == expected);

    bench.says(0, "param set /modulo_camera use_sim_time false");
    images.until("an image of the machine's time", |image| image.stamp().sec > 1_000_000_000);
    assert!(!clock.wanted(), "nobody reads /clock any more");

    bench.says(0, "param set /modulo_camera use_sim_time true");
    images.until("an image of the simulated time again", |image| image.stamp() == expected);
}

/// A reader of the verdicts alone gets them, and the node is on the topic once.
#[test]
fn verdicts_need_no_reader_of_the_images() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let verdicts = peer.hear("/diagnostics", MessageKind::Diagnostics);
    let _unwrap = bench.start(&["run", "unwrap"]);
    let _camera = camera(&bench, "");
    for name in ["unwrap: recovery", "unwrap"] {
        let named = |m: &Message| matches!(m, Message::Diagnostics(all) if all.status[0].name == name);
        verdicts.until(name, named);
    }
    let graph = peer.transport.graph();
    let writers = graph.endpoints(EntityKind::Publisher, "/diagnostics").map(|token| token.node_name());
    assert_eq!(writers.filter(|name| name == "/unwrap").count(), 1);
}

#[test]
fn unreadable_messages_are_warned_of_by_count() {
    let bench = Bench::new();
    let unwrap = bench.start(&["run", "unwrap"]);
    let peer = Peer::new(&bench);
    let logs = peer.hear("/rosout", MessageKind::Log);
    wait_until("the node", || peer.transport.is_ready("/unwrap"));
    // Each message of this topic is counted; of images only the newest one would wait.
    let endpoint = Endpoint {
        topic: "/sensor_info".into(),
        dds_type: modulo_msgs::dds_name(MessageKind::Diagnostics.type_name()),
        type_hash: MessageKind::Diagnostics.type_hash(),
        qos: ":1:,1:,:,:,,".into(),
    };
    let broken = peer.transport.advertise_raw(&peer.node_name, &endpoint).expect("declared");
    wait_until("the reader", || broken.wanted());
    let mut expected = Vec::new();
    let skipped = |m: &Message| log(m.clone()).msg.starts_with("skipped: ");
    for _ in 0..40 {
        broken.put(vec![0, 1, 0, 0, 9]).expect("sent");
    }
    expected.push(log(logs.until("the first warning", skipped)).msg);
    assert!(expected[0].contains("/sensor_info") && !expected[0].contains("since"), "{expected:?}");
    assert_eq!(unwrap.interrupt(), Some(0));
    let count = |line: &String| {
        let before = line.split_once(" since the last warning").map_or("1", |(text, _)| text);
        let number = before.rsplit(' ').find_map(|word| word.parse::<u32>().ok());
        number.unwrap_or_else(|| panic!("a count: {line}"))
    };
    while expected.iter().map(count).sum::<u32>() < 40 {
        expected.push(log(logs.until("a warning with a count", skipped)).msg);
    }
    assert_eq!(expected.iter().map(count).sum::<u32>(), 40, "{expected:?}");
    assert!(expected.len() < 40, "{expected:?}");
}

#[test]
fn the_level_of_the_log_is_read_and_set_by_services() {
    let bench = Bench::new();
    let _plain = bench.start(&["run", "unwrap", "--ros-args", "-r", "__node:=plain"]);
    let _unwrap = bench.start(&["run", "unwrap", "--ros-args", "-p", "enable_logger_service:=true"]);
    let peer = Peer::new(&bench);
    wait_until("both nodes", || peer.transport.is_ready("/plain") && peer.transport.is_ready("/unwrap"));
    let logs = peer.hear("/rosout", MessageKind::Log);
    let call = |name: &str, request: Vec<u8>| {
        let ros_type = if name.starts_with("get") { "GetLoggerLevels" } else { "SetLoggerLevels" };
        let (service, ros_type) = (format!("/unwrap/{name}"), format!("rcl_interfaces/srv/{ros_type}"));
        peer.transport.call(&service, &ros_type, request, Duration::from_secs(10)).expect("answered")
    };
    let request = cdr::to_vec(&GetLoggerLevelsRequest { names: vec!["unwrap".into()] }).expect("short");
    let level = || {
        let answer = call("get_logger_levels", request.clone());
        cdr::from_slice::<GetLoggerLevelsResponse>(&answer).expect("a response").levels[0].level
    };
    let set = |level| {
        let levels = vec![LoggerLevel { name: "unwrap".into(), level }];
        let answer =
            call("set_logger_levels", cdr::to_vec(&SetLoggerLevelsRequest { levels }).expect("short"));
        cdr::from_slice::<SetLoggerLevelsResponse>(&answer).expect("a response").results[0].successful
    };
    // A refusal is a warning.
    let refused = |alpha: &str| {
        bench.says(1, &format!("param set /unwrap alpha {alpha}"));
    };
    assert_eq!(level(), u32::from(Log::INFO));
    assert!(set(Log::ERROR.into()) && level() == u32::from(Log::ERROR));
    refused("1001");
    // One refusal a second is told.
    std::thread::sleep(Duration::from_millis(1100));
    assert!(set(Log::WARN.into()) && !set(7));
    refused("1002");
    let warned = log(logs.until("a refusal", |m| log(m.clone()).msg.contains("'alpha' = 100")));
    assert!(warned.msg.contains("1002"), "the refusal before it has a lower level: {}", warned.msg);

    let graph = peer.transport.graph();
    let servers = graph.endpoints(EntityKind::Server, "/plain/set_logger_levels").count();
    assert_eq!(servers, 0, "only on request, as in ROS 2");
}

fn compressed(message: &Message) -> &CompressedImage {
    match message {
        Message::CompressedImage(file) => file,
        other => panic!("a compressed image, not {other:?}"),
    }
}

/// The compressed variants of image topics: published for their readers, and read where a node is told to.
#[test]
fn images_travel_as_files_where_they_are_asked_for() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let logs = peer.hear("/rosout", MessageKind::Log);
    let files = peer.hear("/recovered/compressed", MessageKind::CompressedImage);
    let _unwrap = bench.start(&["run", "unwrap", "--ros-args", "-p", "image_transport:=compressed"]);
    wait_until("the node", || peer.transport.is_ready("/unwrap"));
    let graph = peer.transport.graph();
    let readers = graph.endpoints(EntityKind::Subscription, "/modulo").count();
    assert_eq!(readers, 0, "only the compressed variant");
    let infos = peer.hear("/camera_info", MessageKind::CameraInfo);
    let _camera = camera(&bench, "");

    let file = files.until("a file", |_| true);
    let CompressedImage { header, format, data } = compressed(&file);
    assert_eq!((header.frame_id.as_str(), format.as_str()), ("camera_optical", "rgb8; jpeg compressed bgr8"));
    assert_eq!(image::guess_format(data).expect("a file"), image::ImageFormat::Jpeg);
    let info = infos.until("the size of an image", |_| true);
    let Message::CameraInfo(info) = info else { panic!("a camera info, not {info:?}") };
    assert_eq!((info.width, info.height, info.header.frame_id.as_str()), (96, 64, "camera_optical"));

    bench.says(0, "param set /unwrap compressed_format png");
    let file = files.until("a PNG file", |m| compressed(m).format == "rgb8; png compressed bgr8");
    let pixels = image::load_from_memory(&compressed(&file).data).expect("a file").to_rgb8();
    let truth = image::open(bench.path("images").join("000000.png")).expect("an image").to_rgb8();
    assert_eq!(pixels.dimensions(), truth.dimensions());

    let modulo = peer.advertise("/modulo/compressed", MessageKind::CompressedImage);
    wait_until("the reader", || modulo.wanted());
    let mut jpeg = std::io::Cursor::new(Vec::new());
    truth.write_to(&mut jpeg, image::ImageFormat::Jpeg).expect("written");
    let jpeg = CompressedImage { format: "jpeg".into(), data: jpeg.into_inner(), ..Default::default() };
    modulo.put(&Message::CompressedImage(jpeg.into())).expect("sent");
    let warned = log(logs.until("a refusal", |m| log(m.clone()).msg.contains("JPEG changes the values")));
    assert!(warned.msg.contains("publish it as PNG"), "{}", warned.msg);
}

/// A detector of a camera of 12 bits, whose images say 16, names the parameter that helps, and says it once.
#[test]
fn codes_of_twelve_bits_in_sixteen_are_told_once() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let images = peer.advertise("/camera/image_raw", MessageKind::Image);
    let (logs, boxes) =
        (peer.hear("/rosout", MessageKind::Log), peer.hear("/detector/detections", MessageKind::Detections));
    let _detector = bench.starts(&format!("{DETECTOR} -p input:=/camera/image_raw"));
    wait_until("the detector", || peer.transport.is_ready("/detector") && images.wanted());
    let pixels = Array3::from_elem((64, 96, 1), 4000u16);
    let frame = Frame::from_u16(pixels).expect("a frame");
    let answer_to = |sec: i32| {
        let header = Header { stamp: Time { sec, nanosec: 0 }, frame_id: "camera".into() };
        let image = StampedFrame { header, frame: frame.clone() };
        images.put(&Message::Image(image.into())).expect("sent");
        boxes.until("an answer", |message| message.stamp().sec == sec);
    };
    (1..4).for_each(answer_to);
    assert_eq!(peer.set("/detector", "bits", "12"), Ok(()));
    answer_to(4);
    // Refused, so that a later line ends the search.
    assert!(peer.set("/detector", "bits", "99").is_err());
    let warnings = RefCell::new(Vec::new());
    logs.until("the refusal", |message| {
        let Log { msg, .. } = log(message.clone());
        let is_last = msg.contains("'bits' = 99");
        if msg.contains("parameter bits") {
            warnings.borrow_mut().push(msg);
        }
        is_last
    });
    let warnings = warnings.into_inner();
    assert!(warnings.len() == 1 && warnings[0].contains("set the parameter bits to 12"), "{warnings:?}");
}

/// A real camera in YUV with its calibration: each stream of the suite has the calibration beside it, and the topic of the camera
/// itself stays alone.
#[test]
fn the_calibration_of_a_camera_is_beside_each_stream() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let images = peer.advertise_raw("/front/image_raw", MessageKind::Image);
    let calibration = peer.advertise("/front/camera_info", MessageKind::CameraInfo);
    let start = |node: &str, namespace: &str, more: &[&str]| {
        let namespace = format!("__ns:={namespace}");
        bench.start(&[&["run", node, "--ros-args", "-r", &namespace][..], more].concat())
    };
    let source = ["-p", "source:=topic:/front/image_raw", "-p", "optical_black:=0"];
    let _nodes = [
        start("modulo_camera", "/suite", &source),
        start("unwrap", "/suite", &[]),
        start("modulo_camera", "/front", &source),
    ];
    let streams = ["/suite/modulo", "/suite/saturated", "/suite/ideal", "/suite/recovered", "/front/ideal"];
    let streams = streams.map(|topic| peer.hear(topic, MessageKind::Image));
    let infos = peer.hear("/suite/camera_info", MessageKind::CameraInfo);
    let of_source = peer.hear("/front/camera_info", MessageKind::CameraInfo);
    let nodes = ["/suite/modulo_camera", "/suite/unwrap", "/front/modulo_camera"];
    wait_until("the nodes", || nodes.iter().all(|node| peer.transport.is_ready(node)));
    let subscribers = peer.subscribers("/front/camera_info");
    assert!(subscribers.contains(&"/suite/modulo_camera".to_owned()), "{subscribers:?}");
    assert!(!subscribers.contains(&"/front/modulo_camera".to_owned()), "its own topic: {subscribers:?}");

    // 64 x 48 px, grey without chroma, until each stream has shown one.
    let (sender, stop) = std::sync::mpsc::channel::<()>();
    let k = [80.0, 0.0, 32.0, 0.0, 81.0, 24.0, 0.0, 0.0, 1.0];
    let sending = std::thread::spawn(move || {
        for sec in 1.. {
            let header = Header { stamp: Time { sec, nanosec: 0 }, frame_id: "lens".into() };
            let info = CameraInfo { header: header.clone(), height: 48, width: 64, k, ..Default::default() };
            calibration.put(&Message::CameraInfo(info.into())).expect("sent");
            let (encoding, data) = ("yuyv".into(), [180, 128].repeat(64 * 48));
            let image = Image { header, height: 48, width: 64, encoding, is_bigendian: 0, step: 128, data };
            images.put(cdr::to_vec(&image).expect("encodes")).expect("sent");
            if stop.recv_timeout(Duration::from_millis(50)) != Err(RecvTimeoutError::Timeout) {
                break;
            }
        }
    });
    let is_calibrated = |m: &Message| matches!(m, Message::CameraInfo(info) if info.k == k);
    let info = infos.until("a calibration", is_calibrated);
    assert!(info.stamp().sec > 0);
    for stream in &streams {
        let Message::Image(image) = stream.until("an image", |_| true) else { unreachable!("an image") };
        assert_eq!((image.frame.dim(), image.header.frame_id.as_str()), ((48, 64, 3), "lens"));
    }
    let Message::Image(ideal) = streams[2].until("an image", |_| true) else { unreachable!("an image") };
    // 1.164 (180 - 16) of 255, in the 1024 codes of 8 bits and alpha 4.
    let sample = ideal.frame.to_f32()[(24, 32, 1)];
    assert!((sample - 191.0).abs() <= 2.0, "{sample}");
    while let Some(message) = of_source.next(Duration::ZERO) {
        assert!(is_calibrated(&message), "one publisher on the topic of the source: {message:?}");
    }
    drop(sender);
    sending.join().expect("it has sent");
}

/// A late reader learns what the class ids of a detector mean, and that they have changed.
#[test]
fn class_ids_have_a_meaning_on_a_topic() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let boxes = peer.hear("/detector/detections", MessageKind::Detections);
    let _detector = bench.starts(&format!("{DETECTOR} -p input:=ideal"));
    let _camera = camera(&bench, "");
    boxes.until("an answer", |_| true);
    let late = Peer::new(&bench);
    let infos = late.hear("/detector/vision_info", MessageKind::VisionInfo);
    let labels = late.hear("/detector/label_info", MessageKind::LabelInfo);
    let version = |wanted: i32| {
        let of_version = |m: &Message| matches!(m, Message::VisionInfo(i) if i.database_version == wanted);
        let Message::VisionInfo(info) = infos.until("a vision info", of_version) else { unreachable!() };
        let meaning = (info.method.as_str(), info.database_location.as_str());
        assert_eq!(meaning, ("rows.onnx", "/detector/label_info"));
    };
    version(1);
    let Message::LabelInfo(all) = labels.until("the labels", |_| true) else { unreachable!() };
    let has_car = all.class_map.iter().any(|class| class.class_name == "car");
    assert!(all.class_map.len() > 1 && has_car, "{all:?}");
    bench.says(0, "param set /detector classes [car]");
    version(2);
    let one = |m: &Message| matches!(m, Message::LabelInfo(info) if info.class_map.len() == 1);
    labels.until("the one class that is published", one);
}

#[test]
fn quality_of_service_is_overridden_by_parameters() {
    let bench = Bench::new();
    let own = |policy: &str| format!("qos_overrides./car/recovered.publisher.{policy}");
    let (reliability, depth) = (own("reliability:=reliable"), own("depth:=7"));
    let place = ["run", "unwrap", "--ros-args", "-r", "__ns:=/car", "-p"];
    let _unwrap = bench.start(&[&place[..], &[&reliability, "-p", &depth]].concat());
    let peer = Peer::new(&bench);
    wait_until("the node", || peer.transport.is_ready("/car/unwrap"));
    let graph = peer.transport.graph();
    let qos = |topic: &str| {
        let publisher = graph.endpoints(EntityKind::Publisher, topic).next().expect("a publisher");
        publisher.endpoint.as_ref().expect("on a topic").qos.clone()
    };
    assert_eq!((qos("/car/recovered"), qos("/car/hdr")), ("::,7:,:,:,,".into(), "2::,5:,:,:,,".into()));
    let got = bench.run(&["param", "get", "/car/unwrap", &own("reliability")]);
    assert_eq!(text(&got), "String value is: reliable\n");
    let set = bench.ends(1, &["param", "set", "/car/unwrap", &own("reliability"), "best_effort"]);
    assert_has(&set, &["is read-only"]);
    for (setting, why) in
        [(own("history:=keep_all"), "must be one of keep_last"), (own("depth:=0"), "must be in 1 to")]
    {
        let refused = bench.ends(2, &[&place[..], &[&setting]].concat());
        assert!(refused.contains(why), "{refused}");
    }
}

#[test]
fn hidden_names_are_listed_on_request() {
    let bench = Bench::new();
    let _unwrap = bench.start(&["run", "unwrap", "--ros-args", "-r", "__ns:=/_car"]);
    let peer = Peer::new(&bench);
    let hidden = modulo_runtime::NodeName::new("_tool", "/", &[]).expect("a name");
    let _tool = peer.transport.announce(&hidden).expect("a token");
    wait_until("the node", || peer.transport.is_ready("/_car/unwrap"));
    let listed =
        |arguments: &[&str]| text(&bench.run(arguments)).lines().map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(listed(&["node", "list"]), ["/_car/unwrap", "/peer"]);
    assert_eq!(listed(&["node", "list", "-a"]), ["/_car/unwrap", "/_tool", "/peer"]);
    assert_eq!(listed(&["node", "list", "--all"]).len(), 3);
    let topics = listed(&["topic", "list"]);
    assert!(topics.contains(&"/diagnostics".to_owned()) && !topics.join(" ").contains("/_"), "{topics:?}");
    let all = listed(&["topic", "list", "--include-hidden-topics"]);
    for topic in ["/_modulo/taken", "/_car/recovered", "/diagnostics"] {
        assert!(all.iter().any(|listed| listed == topic), "{all:?}");
    }
}

/// zenoh is silent about a peer that speaks of another type: the node is not.
#[test]
fn a_peer_that_does_not_fit_is_reported_once() {
    let bench = Bench::new();
    let _unwrap = bench.start(&["run", "unwrap"]);
    let peer = Peer::new(&bench);
    wait_until("the node", || peer.transport.is_ready("/unwrap"));
    let logs = peer.hear("/rosout", MessageKind::Log);
    let endpoint = |dds_type: &str, type_hash: &str| Endpoint {
        topic: "/modulo".into(),
        dds_type: dds_type.into(),
        type_hash: type_hash.into(),
        qos: "2::,5:,:,:,,".into(),
    };
    let image = "sensor_msgs::msg::dds_::Image_";
    let other = format!("RIHS01_{}", "0".repeat(64));
    let advertise = || peer.transport.advertise_raw(&peer.node_name, &endpoint(image, &other)).expect("sent");
    let _first = advertise();
    let warned = log(logs.until("a warning", |m| log(m.clone()).level == Log::WARN));
    for word in ["/modulo", "/peer", "/unwrap", "sensor_msgs/msg/Image", &other] {
        assert!(warned.msg.contains(word), "{word}: {}", warned.msg);
    }
    // The same again is nothing new; another type is.
    let _again = advertise();
    let text_type = endpoint("std_msgs::msg::dds_::String_", &other);
    let _other = peer.transport.advertise_raw(&peer.node_name, &text_type).expect("sent");
    let warned = log(logs.until("a warning", |m| log(m.clone()).level == Log::WARN));
    assert!(warned.msg.contains("std_msgs/msg/String"), "{}", warned.msg);

    assert_has(&bench.says(0, "topic info /modulo"), &[&other, "nothing arrives"]);
}

/// `MODULO_TYPE_HASH=none` speaks as ROS 2 Humble does, and says so to those that do not.
#[test]
fn without_hashes_it_speaks_with_humble() {
    let bench = Bench::new();
    let mut unwrap = bench.modulo(&["run", "unwrap"]);
    let unwrap = unwrap.env("MODULO_TYPE_HASH", "none").stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    let _unwrap = Background(unwrap.expect("the binary starts"));
    let peer = Peer::with_hashes(&bench, Hashes::None);
    wait_until("the node", || peer.transport.is_ready("/unwrap"));
    let graph = peer.transport.graph();
    let hashes: Vec<_> = graph.tokens().filter_map(|t| t.endpoint.clone()).map(|e| e.type_hash).collect();
    assert!(hashes.len() > 8 && hashes.iter().all(|hash| hash == NO_HASH), "{hashes:?}");

    assert_has(&bench.says(1, "param get /unwrap method"), &["MODULO_TYPE_HASH=none"]);
    for (hash, code, said) in [("none", 0, "auto"), ("md5", 2, "rihs01 and none are possible")] {
        let mut get = bench.modulo(&["param", "get", "/unwrap", "method"]);
        let output = get.env("MODULO_TYPE_HASH", hash).output().expect("the binary starts");
        assert_eq!(output.status.code(), Some(code), "{hash}: {}", text(&output));
        assert_has(&text(&output), &[said]);
    }
}

/// A type that the suite does not know is described by the node that publishes it.
#[test]
fn messages_of_other_packages_are_shown_and_recorded_with_their_definition() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let (name, inner) = ("demo_msgs/msg/Level", "demo_msgs/msg/Unit");
    let text = format!("Unit unit\nfloat64[] levels\n{}\nMSG: {inner}\nstring symbol\n", "=".repeat(80));
    let type_hash = modulo_msgs::type_hash_of_schema(name, &text).expect("a definition");
    let source = |type_name: &str, text: &str| TypeSource {
        type_name: type_name.into(),
        encoding: "msg".into(),
        raw_file_contents: text.into(),
    };
    let type_sources = vec![source(name, "Unit unit\nfloat64[] levels"), source(inner, "string symbol")];
    let described = GetTypeDescriptionResponse { successful: true, type_sources, ..Default::default() };
    let answer = cdr::to_vec(&described).expect("short");
    let (service, ros_type) = type_description::NAME_AND_TYPE;
    let answer = Box::new(move |_: &[u8]| Ok(answer.clone()));
    let service = RawService { name: service, ros_type, qos: SERVICE_QOS, answer };
    let _service = peer.transport.serve_raw(&peer.node_name, vec![service]).expect("served");
    let endpoint = Endpoint {
        topic: "/level".into(),
        dds_type: modulo_msgs::dds_name(name),
        type_hash: type_hash.clone(),
        qos: "::,10:,:,:,,".into(),
    };
    let publisher = peer.transport.advertise_raw(&peer.node_name, &endpoint).expect("declared");
    let message = cdr::to_vec(&("mm".to_owned(), vec![1.5_f64, -2.0])).expect("short");

    let (bag, mut came) = (bench.path("bag"), 0);
    let recording = bench.record(&bag, &["/level"]);
    let echo = bench.modulo(&["topic", "echo", "/level", "--once"]).stdout(Stdio::piped()).spawn();
    let mut echo = Background(echo.expect("the binary starts"));
    wait_until("an echo", || {
        publisher.put(message.clone()).expect("sent");
        echo.0.try_wait().expect("a child").is_some()
    });
    let shown = std::io::read_to_string(echo.0.stdout.take().expect("kept")).expect("UTF-8");
    assert_eq!(shown, "unit:\n  symbol: \"mm\"\nlevels: [1.5, -2.0]\n---\n");
    wait_until("the recorder", || {
        publisher.put(message.clone()).expect("sent");
        came += 1;
        came > 10 && peer.subscribers("/level") == ["/rosbag2_recorder"]
    });
    assert_eq!(recording.interrupt(), Some(0));
    let topics = BagReader::open(&bag).expect("a whole bag").topics();
    let topic = &topics[0].topic;
    assert_eq!((topic.type_name.as_str(), &topic.type_hash), (name, &type_hash));
    assert_eq!(String::from_utf8_lossy(&topic.schema), text.trim_end());
}

#[test]
fn a_latched_message_waits_for_late_readers() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let endpoint = |qos: &str| Endpoint {
        topic: "/latched".into(),
        dds_type: "std_msgs::msg::dds_::String_".into(),
        type_hash: MessageKind::Log.type_hash(),
        qos: qos.into(),
    };
    let publisher =
        peer.transport.advertise_raw(&peer.node_name, &endpoint(":1:,1:,:,:,,")).expect("declared");
    for byte in [1, 2, 3] {
        publisher.put(vec![0, 1, 0, 0, byte]).expect("sent");
    }
    let late = Peer::new(&bench);
    let hear = |qos: &str| {
        let (sender, samples) = std::sync::mpsc::channel();
        let take = move |sample: modulo_middleware::transport::RawSample| {
            let _ = sender.send((sample.payload[4], sample.attachment.map(|a| a.sequence)));
        };
        (late.transport.subscribe_raw(&late.node_name, &endpoint(qos), take).expect("declared"), samples)
    };
    let (_latched, samples) = hear(":1:,1:,:,:,,");
    assert_eq!(samples.recv_timeout(Duration::from_secs(10)), Ok((3, Some(3))));
    let (_volatile, only_new) = hear("::,1:,:,:,,");
    // On one machine a message takes far less than half a second.
    assert!(samples.recv_timeout(Duration::from_millis(500)).is_err(), "the last one, once");
    wait_until("the publisher's readers", || publisher.wanted());
    publisher.put(vec![0, 1, 0, 0, 4]).expect("sent");
    for samples in [&samples, &only_new] {
        assert_eq!(samples.recv_timeout(Duration::from_secs(10)), Ok((4, Some(4))));
    }
}

/// Every detection message of a bag.
fn detections(bag: &Path) -> Vec<Detection2DArray> {
    let bag = BagReader::open(bag).expect("a whole bag");
    let messages = bag.messages(&Selection::of(["/detector/detections"]));
    messages.map(|m| cdr::from_slice(&m.expect("readable").data).expect("detections")).collect()
}

fn images(bag: &Path, topic: &str) -> Vec<Image> {
    let bag = BagReader::open(bag).expect("a whole bag");
    let messages = bag.messages(&Selection::of([topic]));
    messages.map(|m| cdr::from_slice(&m.expect("readable").data).expect("an image")).collect()
}

#[test]
fn a_recorded_run_replayed_gives_the_same_boxes() {
    let bench = Bench::new();
    bench.images(5);
    let (live, again) = (bench.path("live"), bench.path("again"));

    let recording = bench.record(&live, &[]);
    bench.says(0, "launch launch/recovered.launch.yaml source:=@/images model:=% engine:=rten");
    assert_eq!(recording.interrupt(), Some(0));
    let first = detections(&live);
    assert_eq!(first.len(), 5);
    let modulo = images(&live, "/modulo");
    let recorded = BagReader::open(&live).expect("a whole bag").topics();
    let files = recorded.iter().filter(|topic| topic.topic.name.ends_with("/compressed")).count();
    assert_eq!(files, 0, "images are recorded once");
    for node in ["modulo_camera", "unwrap", "detector"] {
        let state = format!("/{node}/state");
        assert!(recorded.iter().any(|topic| topic.topic.name == state), "{state} is recorded");
    }
    for (array, image) in first.iter().zip(&modulo) {
        assert_eq!(array.header, image.header, "a result carries stamp and frame of its image");
        for detection in &array.detections {
            let bbox = detection.to_detection().expect("a class").bbox;
            assert!(bbox.x1 >= 0.0 && bbox.y1 >= 0.0 && bbox.x2 <= 96.0 && bbox.y2 <= 64.0, "{bbox:?}");
        }
    }

    let recording = bench.record(&again, &[]);
    bench.says(0, "launch launch/replay.launch.yaml bag:=@/live model:=% engine:=rten play_rate:=0");
    assert_eq!(recording.interrupt(), Some(0));
    // The recorder may subscribe to the topic after the first results, but then it misses no result.
    let second = detections(&again);
    assert!(!second.is_empty() && first.ends_with(&second), "{second:?}\n{first:?}");
}

/// A camera may run on another machine, and is not ended together with its readers.
#[test]
fn a_node_ends_when_asked_although_its_camera_goes_on() {
    let bench = Bench::new();
    let mut camera = camera(&bench, "");
    let unwrap = bench.start(&["run", "unwrap"]);
    let detector = bench.starts(DETECTOR);
    let peer = Peer::new(&bench);
    let boxes = peer.hear("/detector/detections", MessageKind::Detections);
    boxes.until("the boxes of an image", |_| true);
    // From the end of unwrap on, nothing but the sensor's description comes to the detector.
    for (name, mut node) in [("unwrap", unwrap), ("detector", detector)] {
        signal(node.0.id(), "INT");
        wait_until(&format!("the end of {name}"), || node.0.try_wait().expect("it was started").is_some());
    }
    assert!(camera.0.try_wait().expect("it was started").is_none(), "the camera goes on");
}
