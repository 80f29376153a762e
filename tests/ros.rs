//! The suite as ROS 2 sees it: logs on `/rosout`, simulated time, late readers,
//! peers that do not fit.

mod harness;

use std::time::Duration;

use harness::peer::Peer;
use harness::{Background, Bench, arg, text, wait_until};
use modulo_msgs::rcl_interfaces::Log;
use modulo_msgs::rosgraph_msgs;
use modulo_msgs::std_msgs::Time;
use modulo_runtime::transport::Transport;
use modulo_runtime::transport::keys::{Endpoint, EntityKind, Hashes, NO_HASH};
use modulo_runtime::{Message, MessageKind};

/// A camera that sends small images for ever.
fn camera(bench: &Bench, more: &[&str]) -> Background {
    let source = arg("source", bench.images(3));
    let own = ["run", "modulo_camera", "--ros-args", "-p", &source, "-p", "loop:=true", "-p", "rate:=20"];
    bench.start(&[&own[..], more].concat())
}

fn log(message: Message) -> Log {
    match message {
        Message::Log(log) => Log::clone(&log),
        other => panic!("a log line, not {other:?}"),
    }
}

fn stamp_of(message: &Message) -> Time {
    message.stamp()
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
    let echoed = bench.run(&["topic", "echo", "/rosout", "--once"]);
    assert_eq!(echoed.status.code(), Some(0), "{}", text(&echoed));
    assert!(text(&echoed).contains("car.unwrap"), "{}", text(&echoed));
}

#[test]
fn stamps_follow_the_clock_topic_while_use_sim_time_is_on() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let images = peer.hear("/modulo", MessageKind::Image);
    let clock = peer.advertise("/clock", MessageKind::Clock);
    let _camera = camera(&bench, &["-p", "use_sim_time:=true"]);

    let first = images.until("an image", |_| true);
    assert_eq!(stamp_of(&first), Time::default(), "0 before the first time on /clock");

    let told = Time { sec: 42, nanosec: 500_000_000 };
    wait_until("the camera on /clock", || clock.wanted());
    clock.put(&Message::Clock(rosgraph_msgs::Clock { clock: told }.into())).expect("sent");
    images.until("an image of the simulated time", |image| stamp_of(image) == told);

    let off = bench.run(&["param", "set", "/modulo_camera", "use_sim_time", "false"]);
    assert_eq!(off.status.code(), Some(0), "{}", text(&off));
    images.until("an image of the machine's time", |image| stamp_of(image).sec > 1_000_000_000);
    assert!(!clock.wanted(), "nobody reads /clock any more");

    let on = bench.run(&["param", "set", "/modulo_camera", "use_sim_time", "true"]);
    assert_eq!(on.status.code(), Some(0), "{}", text(&on));
    images.until("an image of the simulated time again", |image| stamp_of(image) == told);
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

    let info = bench.run(&["topic", "info", "/modulo"]);
    assert!(text(&info).contains(&other) && text(&info).contains("nothing arrives"), "{}", text(&info));
}

/// `--hash none` speaks as ROS 2 Humble does, and says so to those that do not.
#[test]
fn without_hashes_it_speaks_with_humble() {
    let bench = Bench::new();
    let _unwrap = bench.start(&["--hash", "none", "run", "unwrap"]);
    let peer = Peer::with_hashes(&bench, Hashes::None);
    wait_until("the node", || peer.transport.is_ready("/unwrap"));
    let graph = peer.transport.graph();
    let hashes: Vec<_> = graph.tokens().filter_map(|t| t.endpoint.clone()).map(|e| e.type_hash).collect();
    assert!(hashes.len() > 8 && hashes.iter().all(|hash| hash == NO_HASH), "{hashes:?}");

    let got = bench.run(&["--hash", "none", "param", "get", "/unwrap", "method"]);
    assert!(got.status.success() && text(&got).contains("auto"), "{}", text(&got));
    let by_variable =
        bench.modulo(&["param", "get", "/unwrap", "method"]).env("MODULO_TYPE_HASH", "none").output();
    assert_eq!(by_variable.expect("the binary starts").status.code(), Some(0));

    let deaf = bench.run(&["param", "get", "/unwrap", "method"]);
    assert_eq!(deaf.status.code(), Some(1));
    assert!(text(&deaf).contains("--hash none"), "{}", text(&deaf));
    let wrong = bench.modulo(&["param", "get", "/unwrap", "method"]).env("MODULO_TYPE_HASH", "md5").output();
    assert_eq!(wrong.expect("the binary starts").status.code(), Some(2));
}

/// A late reader of a latched topic gets the last message, and no other.
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
        let take = move |sample: modulo_runtime::transport::RawSample| {
            let _ = sender.send((sample.payload[4], sample.attachment.map(|a| a.sequence)));
        };
        (late.transport.subscribe_raw(&late.node_name, &endpoint(qos), take).expect("declared"), samples)
    };
    let (_latched, samples) = hear(":1:,1:,:,:,,");
    assert_eq!(samples.recv_timeout(Duration::from_secs(10)), Ok((3, Some(3))));
    let (_volatile, only_new) = hear("::,1:,:,:,,");
    assert!(samples.recv_timeout(Duration::from_millis(500)).is_err(), "the last one, once");
    wait_until("the publisher's readers", || publisher.wanted());
    publisher.put(vec![0, 1, 0, 0, 4]).expect("sent");
    for samples in [&samples, &only_new] {
        assert_eq!(samples.recv_timeout(Duration::from_secs(10)), Ok((4, Some(4))));
    }
}
