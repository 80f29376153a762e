//! A running suite: nodes without input, disabled nodes, an input that follows the trust, and traces.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, BufReader};
use std::process::Stdio;
use std::time::Duration;

use modulo_core::Frame;
use modulo_middleware::transport::Transport;
use modulo_msgs::cdr;
use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus};
use modulo_msgs::std_srvs::{SetBoolRequest, SetBoolResponse};
use modulo_runtime::{Message, MessageKind, Qos, StampedFrame};
use serde_json::Value;

use crate::harness::{Background, Bench, Heard, Peer, assert_has, signal, text, wait_until};

/// Waits for a log line that contains `text`.
fn line(log: &Heard, text: &str) -> String {
    let message = log.until(text, |message| matches!(message, Message::Log(log) if log.msg.contains(text)));
    let Message::Log(line) = message else { unreachable!("it was a line") };
    line.msg.clone()
}

/// Waits for a status of `name` that `wanted` takes.
fn status(heard: &Heard, name: &str, wanted: impl Fn(&DiagnosticStatus) -> bool) -> DiagnosticStatus {
    let of = |array: &DiagnosticArray| array.status.iter().find(|s| s.name == name && wanted(s)).cloned();
    let found = |message: &Message| match message {
        Message::Diagnostics(array) => of(array),
        _ => None,
    };
    let message = heard.until(name, |message| found(message).is_some());
    found(&message).expect("it was found")
}

fn value<'a>(status: &'a DiagnosticStatus, key: &str) -> &'a str {
    status.values.iter().find(|value| value.key == key).map_or("", |value| &value.value)
}

#[test]
fn a_node_without_input_names_the_topics_that_exist() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let log = peer.hear_as("/rosout", MessageKind::Log, Qos::Logs);
    let diagnostics = peer.hear("/diagnostics", MessageKind::Diagnostics);
    let _other = peer.advertise("/front/modulo", MessageKind::Image);
    let sensor = ["run", "unwrap", "--ros-args", "-p", "bits:=8", "-p", "alpha:=4.0"];
    let _node = bench.start(&sensor);
    let warning = line(&log, "no image has come on /modulo");
    assert!(warning.contains("no node publishes it") && warning.contains("/front/modulo"), "{warning}");
    let silent = status(&diagnostics, "unwrap", |status| status.level == DiagnosticStatus::WARN);
    assert!(silent.message.contains("no image has come on /modulo"), "{silent:?}");

    let modulo = peer.advertise("/modulo", MessageKind::Image);
    let frame = Frame::from_u8(ndarray::Array3::zeros((8, 8, 3))).expect("a frame");
    let image = Message::Image(StampedFrame { header: Default::default(), frame }.into());
    wait_until("the node goes on", || {
        modulo.put(&image).expect("sent");
        let next = log.next(Duration::from_millis(100));
        matches!(next, Some(Message::Log(log)) if log.msg.contains("an image has come on /modulo"))
    });
    status(&diagnostics, "unwrap", |status| status.level == DiagnosticStatus::OK);
}

/// Also between processes, where the description of the sensor was sent before the detector was there.
#[test]
fn a_detector_is_ready_when_its_model_has_run_at_the_size_that_its_camera_tells() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let scene = "source:=scene://day?seed=1&frames=2&width=160&height=96";
    let _camera =
        bench.start(&["run", "modulo_camera", "--ros-args", "-p", scene, "-p", "wait_for:=[detector]"]);
    wait_until("the camera is there", || !peer.transport.publishers("/sensor_info").is_empty());
    // Its first lines on /rosout may come before this reader is known to it; its standard error has all.
    let mut detector = bench.modulo(&["run", "detector", "--ros-args", "-p", "engine:=rten"]);
    let detector = detector.env("RUST_LOG", "info").stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
    let mut detector = Background(detector.expect("the binary starts"));
    let lines = BufReader::new(detector.0.stderr.take().expect("a pipe")).lines();
    let told: Vec<String> = lines
        .map(|line| line.expect("a line of text"))
        .take_while(|line| !line.contains(" ready "))
        .collect();
    assert!(told.iter().any(|line| line.contains("the model has run at 160x128")), "{told:?}");
}

/// A replay of rate 0 waits for each node that reads it: one that lacks the description of the sensor lets it go on.
#[test]
fn a_replay_without_sensor_descriptions_is_not_held_up() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let log = peer.hear_as("/rosout", MessageKind::Log, Qos::Logs);
    let _results = peer.hear("/recovered", MessageKind::Image);
    let _node = bench.start(&["run", "unwrap"]);
    wait_until("the node", || peer.transport.is_ready("/unwrap"));
    let begin = std::time::Instant::now();
    bench.says(0, "bag play bags/samples/tunnel --rate 0 --topics /modulo");
    // Twelve frames: without an answer, the player would wait for a minute.
    assert!(begin.elapsed() < Duration::from_secs(40), "{:?}", begin.elapsed());
    line(&log, "no sensor description has come on the topic sensor_info");
}

#[test]
fn images_that_cannot_be_read_are_not_called_silence() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let log = peer.hear_as("/rosout", MessageKind::Log, Qos::Logs);
    let modulo = peer.advertise_raw("/modulo", MessageKind::Image);
    let _node = bench.start(&["run", "unwrap"]);
    wait_until("the node", || peer.transport.is_ready("/unwrap"));
    let mut skipped = 0;
    // Warnings come once a second: with the fourth one, more than the two seconds are over after which a node warns of silence.
    wait_until("warnings", || {
        modulo.put(vec![0, 1, 0, 0, 7]).expect("sent");
        while let Some(Message::Log(line)) = log.next(Duration::from_millis(50)) {
            assert!(!line.msg.contains("sends nothing"), "{}", line.msg);
            skipped += u32::from(line.msg.contains("skipped"));
        }
        skipped >= 4
    });
}

/// A suite at 20 Hz without end.
fn suite(bench: &Bench, more: &str) -> Background {
    bench.images(4);
    let fixed = "source:=@/images model:=% engine:=rten rate:=20 loop:=true";
    bench.starts(&format!("launch launch/recovered.launch.yaml {fixed} {more}"))
}

/// Calls `~/enable` of a node.
fn enable(peer: &Peer, node: &str, data: bool) {
    let request = cdr::to_vec(&SetBoolRequest { data }).expect("short");
    let (service, patience) = (format!("{node}/enable"), Duration::from_secs(30));
    let answer = peer.transport.call(&service, "std_srvs/srv/SetBool", request, patience).expect("an answer");
    let SetBoolResponse { success, message } = cdr::from_slice(&answer).expect("a response");
    assert!(success, "{node}: {message}");
}

/// A reader that leaves, such as `head -1` behind `modulo topic echo TOPIC`, ends the command.
#[test]
fn a_closed_pipe_ends_a_command_that_prints_without_end() {
    let bench = Bench::new();
    let camera = "run modulo_camera --ros-args -p source:=scene://day?width=64&height=32 -p rate:=20.0";
    let _camera = bench.starts(camera);
    for command in [["topic", "echo", "/camera_info"], ["topic", "hz", "/modulo"]] {
        let child = bench.modulo(&command).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let mut printing = Background(child.expect("it starts"));
        let mut reader = BufReader::new(printing.0.stdout.take().expect("piped"));
        let mut line = String::new();
        reader.read_line(&mut line).expect("text");
        assert!(!line.is_empty(), "{command:?}");
        drop(reader);
        wait_until("the end of the command", || printing.0.try_wait().expect("a child").is_some());
        assert_eq!(printing.0.wait().expect("ended").code(), Some(0), "{command:?}");
    }
}

#[test]
fn a_disabled_node_rests_and_goes_on() {
    let bench = Bench::new();
    let running = suite(&bench, "--summary @/summary.json");
    let peer = Peer::new(&bench);
    wait_until("the camera", || peer.transport.is_ready("/modulo_camera"));
    for (node, input, output, kind) in [
        ("detector", "/recovered", "/detector/detections", MessageKind::Detections),
        ("unwrap", "/modulo", "/recovered", MessageKind::Image),
        ("modulo_camera", "", "/modulo", MessageKind::Image),
    ] {
        let name = format!("/{node}");
        let state = peer.hear_as(&format!("{name}/state"), MessageKind::Diagnostics, Qos::Latched);
        let enabled = |wanted: &str| {
            status(&state, &format!("{node}: state"), |status| value(status, "enabled") == wanted);
        };
        peer.hear(output, kind).until("a message", |_| true);
        enabled("true");
        enable(&peer, &name, false);
        enabled("false");
        // A subscription of now hears nothing of before.
        assert!(peer.hear(output, kind).next(Duration::from_millis(200)).is_none(), "{node}");
        wait_until("it reads no more", || !peer.subscribers(input).contains(&name));
        let diagnostics = peer.hear("/diagnostics", MessageKind::Diagnostics);
        let expected = status(&diagnostics, node, |status| value(status, "enabled") == "false");
        assert!(expected.message.contains("disabled"), "{expected:?}");
        if node == "detector" {
            // A source that waits for its readers does not wait for a disabled one.
            peer.set("/modulo_camera", "rate", "0.0").expect("possible");
            let images = peer.hear("/modulo", MessageKind::Image);
            for _ in 0..10 {
                images.until("images", |_| true);
            }
            peer.set("/modulo_camera", "rate", "20.0").expect("possible");
        }
        enable(&peer, &name, true);
        enabled("true");
        peer.hear(output, kind).until("messages again", |_| true);
    }
    assert_eq!(running.interrupt(), Some(0));
    let topics = bench.json("summary.json")["topics"].clone();
    let lost = topics.as_object().expect("topics").values().map(|topic| topic["lost"].as_u64());
    assert_eq!(lost.sum::<Option<u64>>(), Some(0), "{topics}");
}

/// The values of `/diagnostics` that a user looks at first.
#[test]
fn diagnostics_tell_the_rate_the_age_and_what_runs() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let diagnostics = peer.hear("/diagnostics", MessageKind::Diagnostics);
    let running = suite(&bench, "");
    for (node, keys) in [
        ("modulo_camera", &["sense_ms"][..]),
        ("unwrap", &["unwrap_ms", "method", "trusted_share"]),
        ("detector", &["infer_ms", "engine", "device"]),
    ] {
        let number = |status: &DiagnosticStatus, key| value(status, key).parse::<f64>().ok();
        let all = status(&diagnostics, node, |status| {
            number(status, "rate_hz").is_some_and(|rate| rate > 0.0)
                && keys.iter().all(|key| !value(status, key).is_empty())
        });
        let (age, dropped) = (number(&all, "age_ms"), number(&all, "dropped_frames"));
        assert!(age.is_some_and(|age| age > 0.0) && dropped.is_some(), "{all:?}");
    }
    assert_eq!(running.interrupt(), Some(0));
}

/// Read noise of 100 code units leaves no image that can be trusted.
#[test]
fn an_auto_input_follows_the_trust_of_the_unwrapper() {
    let bench = Bench::new();
    let running = suite(&bench, "alpha:=1.0");
    let peer = Peer::new(&bench);
    wait_until("the camera", || peer.transport.is_ready("/modulo_camera"));
    let state = peer.hear_as("/detector/state", MessageKind::Diagnostics, Qos::Latched);
    let detections = peer.hear("/detector/detections", MessageKind::Detections);
    let reads = |stream: &str| {
        let wanted =
            |status: &DiagnosticStatus| value(status, "stream") == stream && value(status, "input") == "auto";
        status(&state, "detector: state", wanted);
        detections.until("boxes", |_| true);
    };
    peer.set("/detector", "fallback", "saturated").expect("possible");
    peer.set("/detector", "input", "auto").expect("possible");
    reads("metered");
    for (noise, stream) in [("100.0", "saturated"), ("0.0", "metered")] {
        peer.set("/modulo_camera", "read_noise", noise).expect("possible");
        reads(stream);
    }
    assert_eq!(running.interrupt(), Some(0));
}

#[test]
fn a_trace_follows_each_frame_through_all_nodes() {
    let bench = Bench::new();
    bench.images(4);
    let fixed = "source:=@/images model:=% engine:=rten --trace @/trace.json";
    let message = bench.says(0, &format!("launch launch/recovered.launch.yaml {fixed}"));
    assert_has(&message, &["spans of 3 nodes, 0 spans were lost"]);
    let trace = bench.json("trace.json");
    let events = trace["traceEvents"].as_array().expect("events");
    let named = |event: &Value, name: &str| event["name"] == name;
    let pids = events.iter().filter(|event| named(event, "process_name"));
    let pids: BTreeMap<_, _> = pids.map(|e| (e["args"]["name"].as_str(), e["pid"].as_u64())).collect();
    let sources = events.iter().filter(|event| event["ph"] == "s").map(|event| event["id"].as_str());
    let frames: BTreeSet<_> = sources.map(|id| id.expect("the stamp of a frame")).collect();
    assert_eq!(frames.len(), 4);
    for frame in frames {
        let begin = |node: &str, stage: &str| {
            let of = |e: &&Value| {
                named(e, stage) && e["pid"].as_u64() == pids[&Some(node)] && e["args"]["frame"] == frame
            };
            let spans: Vec<_> = events.iter().filter(of).collect();
            assert_eq!(spans.len(), 1, "{node} {stage} {frame}");
            spans[0]["ts"].as_f64().expect("a time")
        };
        let way = [("/modulo_camera", "sense"), ("/unwrap", "unwrap"), ("/detector", "infer")];
        let begins = way.map(|(node, stage)| (begin(node, "step"), begin(node, stage)));
        assert!(
            begins.iter().all(|(step, stage)| step <= stage) && begins.is_sorted_by(|a, b| a.1 < b.1),
            "{begins:?}"
        );
        let flow =
            ["s", "t", "f"].map(|ph| events.iter().filter(|e| e["ph"] == ph && e["id"] == frame).count());
        assert_eq!(flow, [1, 1, 1], "{frame}");
    }
}

/// Returns a suite of rate 0 that goes on until it is interrupted.
fn endless_suite(bench: &Bench, summary: &str) -> Background {
    let fixed = "source:=scene://day?frames=8&width=96&height=64 loop:=true engine:=rten model:=%";
    bench.starts(&format!("launch launch/recovered.launch.yaml {fixed} --summary @/{summary}"))
}

/// Two suites in one domain mixed their cameras without a word, and the second camera stood still for a minute.
#[test]
fn two_suites_in_one_domain_say_so() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let log = peer.hear_as("/rosout", MessageKind::Log, Qos::Logs);
    let is_reported = |message: &Message| match message {
        Message::Log(line) => line.msg.contains("ROS_DOMAIN_ID"),
        _ => false,
    };
    let list = || bench.run(&["node", "list"]);
    let first = endless_suite(&bench, "first.json");
    let detections = peer.hear("/detector/detections", MessageKind::Detections);
    detections.until("boxes", |_| true);
    // A recorder, a second look from outside, and a node that is started again are no second suite.
    let recording = bench.record(&bench.path("bag"), &["/modulo", "/recovered"]);
    let _viewer = bench.start(&["view", "--port", "0"]);
    let victim = first.node("unwrap").expect("it runs");
    signal(victim, "KILL");
    wait_until("another process", || first.node("unwrap").is_some_and(|pid| pid != victim));
    std::thread::sleep(Duration::from_secs(4));
    while let Some(message) = log.next(Duration::ZERO) {
        assert!(!is_reported(&message), "{message:?}");
    }
    assert!(!text(&list()).contains("WARNING"), "{}", text(&list()));
    assert_eq!(recording.interrupt(), Some(0));

    let (_heard, frames) = peer.listen("/modulo", MessageKind::Image);
    let second = endless_suite(&bench, "second.json");
    let mut sent = BTreeMap::new();
    wait_until("both cameras go on", || {
        for frame in frames.try_iter() {
            *sent.entry(frame.attachment.expect("each has one").gid).or_insert(0) += 1;
        }
        sent.len() == 2 && sent.values().all(|count| *count >= 30)
    });
    let mut expected: BTreeSet<(String, String)> = BTreeSet::new();
    let mut lines = 0;
    wait_until("a warning of each node of both suites", || {
        while let Some(Message::Log(line)) = log.next(Duration::from_millis(50)) {
            if line.msg.contains("2 nodes are called") && line.msg.contains(&line.name) {
                expected.insert((line.name.clone(), line.msg.clone()));
                lines += 1;
            }
        }
        lines >= 6
    });
    assert_eq!(lines, 6, "{expected:?}");
    let of_camera =
        expected.iter().any(|(_, line)| line.contains("/modulo, ") && line.contains("have 2 publishers"));
    assert!(of_camera, "{expected:?}");
    let listed = text(&list());
    assert_eq!(listed.matches("/unwrap\n").count(), 2, "{listed}");
    assert!(listed.contains("nodes in the graph that share an exact name"), "{listed}");
    assert_has(&bench.says(0, "param get /unwrap method"), &["2 nodes are called /unwrap", "auto"]);

    assert_eq!((second.interrupt(), first.interrupt()), (Some(3), Some(3)));
    let readers = &bench.json("second.json")["readers"];
    let is_told = |one: &Value| one["topic"] == "/modulo" && one["foreign"].as_u64() > Some(0);
    assert!(readers.as_array().is_some_and(|all| all.iter().any(is_told)), "{readers}");
}
