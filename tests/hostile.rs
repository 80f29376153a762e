//! Values that nobody should set: every parameter that can change is set to each of them while the suite runs, and every
//! parameter and launch argument has each of them at a start. A value is taken or refused in a sentence; no node stops,
//! restarts or slows down.

mod harness;

use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use modulo_middleware::parameter::client::ParameterClient;
use modulo_runtime::parameter::{from_ros, to_ros};
use modulo_runtime::{Descriptor, Message, MessageKind, ParameterSet as _, Value};

use harness::{Background, Bench, Heard, Peer, assert_has, model, text, wait_until};
use modulo_msgs::cdr;
use modulo_msgs::rcl_interfaces::{Parameter, SetParametersRequest, SetParametersResponse};

const NODES: [&str; 3] = ["modulo_camera", "unwrap", "detector"];

/// The rate of the camera in the running suite, frames per second.
const RATE: f64 = 20.0;

/// Text that no parameter should be set to.
fn hostile(bench: &Bench, own_topic: &str) -> Vec<String> {
    let (folder, fifo) = (bench.path("empty"), bench.path("fifo"));
    std::fs::create_dir_all(&folder).expect("a writable folder");
    if !fifo.exists() {
        assert!(Command::new("mkfifo").arg(&fifo).status().expect("mkfifo is there").success());
    }
    let [folder, fifo] = [folder, fifo].map(|path| path.display().to_string());
    let words = ["", "a b", "1e300", "-1", "9223372036854775807", ".nan", "/dev/null", "/dev/zero", "[]"];
    let mut all: Vec<String> = words.map(str::to_owned).into();
    all.extend([fifo, folder, own_topic.to_owned(), "x".repeat(1 << 16)]);
    all
}

/// Returns what a user who writes `text` sends to a parameter with the value `present`.
fn value_of(text: &str, present: &Value) -> Value {
    match present {
        // A string is sent as it is, without the rules of YAML.
        Value::String(_) => Value::String(text.to_owned()),
        present => present.parse_like(text).unwrap_or_else(|| Value::guess(text)),
    }
}

/// Sets a parameter of a node; the error is the reason of the refusal.
fn set(peer: &Peer, node: &str, name: &str, value: &Value) -> Result<(), String> {
    let parameters = vec![Parameter { name: name.to_owned(), value: to_ros(Some(value)) }];
    let request = cdr::to_vec(&SetParametersRequest { parameters }).expect("encodes");
    let (service, kind) = (format!("/{node}/set_parameters"), "rcl_interfaces/srv/SetParameters");
    let answer =
        peer.transport.call(&service, kind, request, Duration::from_secs(25)).expect("the node answers");
    let SetParametersResponse { mut results } = cdr::from_slice(&answer).expect("decodes");
    let result = results.pop().expect("one result");
    if result.successful { Ok(()) } else { Err(result.reason) }
}

/// The names and the values of the parameters of a node that can change.
fn changeable(peer: &Peer, node: &str) -> Vec<(String, Value)> {
    let client = ParameterClient::new(&peer.transport, node);
    let names = client.names().expect("the node answers");
    let descriptors = client.descriptors(&names).expect("the node answers");
    let values = client.values(&names).expect("the node answers").into_iter();
    let all = descriptors.into_iter().zip(values.map(|value| from_ros(value).expect("set")));
    let changeable = all.filter(|(descriptor, _)| !descriptor.read_only);
    changeable.map(|(descriptor, value)| (descriptor.name, value)).collect()
}

/// Returns the stamp of the next result, which must come within 2 s.
fn next_stamp(results: &Heard, what: &str) -> u64 {
    // Those that wait already tell nothing about the node as it is now.
    while results.next(Duration::ZERO).is_some() {}
    let start = Instant::now();
    let Some(message) = results.next(Duration::from_secs(30)) else {
        panic!("no frame is answered after {what}")
    };
    let waited = start.elapsed();
    assert!(waited < Duration::from_secs(2), "{waited:?} until the next frame after {what}");
    message.stamp().as_ns()
}

#[test]
fn no_value_of_a_parameter_stops_a_running_node() {
    let bench = Bench::new();
    let source = "source:=scene://glare?seed=1&width=96&height=64 model:=% engine:=rten loop:=true";
    let running = bench.starts(&format!("launch launch/recovered.launch.yaml {source} rate:={RATE}"));
    let peer = Peer::new(&bench);
    let results = peer.hear("/detector/detections", MessageKind::Detections);
    wait_until("the first frame is answered", || results.next(Duration::from_secs(1)).is_some());
    let processes = || NODES.map(|node| running.node(node));
    let (before, mut refused, mut accepted) = (processes(), 0, Vec::new());
    for (node, own_topic) in NODES.iter().zip(["topic:/modulo", "/recovered", "/detector/annotated"]) {
        for (name, present) in changeable(&peer, node) {
            for text in hostile(&bench, own_topic) {
                let shown: String = text.chars().take(40).collect();
                let what = format!("{node} {name} = '{shown}'");
                match set(&peer, node, &name, &value_of(&text, &present)) {
                    Ok(()) => accepted.push(what.clone()),
                    Err(why) => {
                        assert!(why.contains(&format!("'{name}'")), "{what}: {why}");
                        let late = ["did not answer", "still loading"].map(|late| why.contains(late));
                        assert_eq!(late, [false; 2], "{what}: {why}");
                        refused += 1;
                    }
                }
                next_stamp(&results, &what);
                set(&peer, node, &name, &present).unwrap_or_else(|why| panic!("{what}, and back: {why}"));
            }
            // An own topic of the node is refused by each parameter that names a topic.
            let closed = ["source", "input", "fallback"].contains(&name.as_str());
            assert!(
                !closed || !accepted.iter().any(|what| what.ends_with(&format!("{own_topic}'"))),
                "{accepted:?}"
            );
        }
    }
    println!("{refused} values refused, {} taken: {accepted:#?}", accepted.len());
    assert!(refused > 300, "{refused}");
    assert_rate(&results);
    assert_eq!(processes(), before, "no node has crashed");
    assert_eq!(running.interrupt(), Some(0), "and no frame was lost");
}

/// A peer filled 26.9 MB of a log in 32 s, and wrote lines of its own into it.
#[test]
fn a_flood_of_calls_leaves_a_short_log() {
    let bench = Bench::new();
    let log = bench.path("log");
    let source =
        format!("source:=scene://glare?width=96&height=64 model:={} engine:=rten loop:=true", model());
    let words = format!("launch launch/recovered.launch.yaml rate:=10 {source}");
    let mut command = bench.modulo(&words.split(' ').collect::<Vec<_>>());
    let file = std::fs::File::create(&log).expect("writable");
    let running = Background(command.stdout(Stdio::null()).stderr(file).spawn().expect("it starts"));
    let peer = Peer::new(&bench);
    let results = peer.hear("/detector/detections", MessageKind::Detections);
    wait_until("the first frame is answered", || results.next(Duration::from_secs(1)).is_some());

    let forged = format!("\n2026-01-01T00:00:00Z ERROR forged\0\u{1b}[31m{}", "x".repeat(1 << 16));
    let (end, calls) = (Instant::now() + Duration::from_secs(8), AtomicU32::new(0));
    std::thread::scope(|scope| {
        for node in &NODES {
            let (peer, forged, calls) = (&peer, &forged, &calls);
            scope.spawn(move || {
                let kind = "rcl_interfaces/srv/SetParameters";
                while Instant::now() < end {
                    set(peer, node, forged, &Value::Bool(true)).expect_err("no such parameter");
                    set(peer, node, "log_level", &Value::String(forged.clone())).expect_err("no such level");
                    let service = format!("/{node}/set_parameters");
                    let _ =
                        peer.transport.call(&service, kind, vec![0, 1, 0, 0, 9], Duration::from_millis(20));
                    calls.fetch_add(3, Ordering::Relaxed);
                }
            });
        }
    });
    next_stamp(&results, "after the flood");
    assert_eq!(running.interrupt(), Some(0), "no frame was lost");
    let (text, calls) = (std::fs::read_to_string(&log).expect("UTF-8"), calls.into_inner());
    println!("{calls} calls, {} bytes of log", text.len());
    // At most 100 kB in 30 s.
    assert!(calls > 100 && text.len() < 26_000, "{calls} calls, {} bytes", text.len());
    assert!(text.contains("forged") && !text.lines().any(|line| line.starts_with("2026-01-01")), "{text}");
    assert!(!text.contains(|c: char| c.is_control() && c != '\n'), "{text}");
}

/// Twenty frames are at the rate of the camera, by their stamps.
fn assert_rate(results: &Heard) {
    let stamps: Vec<u64> = (0..20).map(|_| results_in_order(results)).collect();
    let periods: Vec<f64> = stamps.windows(2).map(|pair| (pair[1] - pair[0]) as f64 / 1e9 * RATE).collect();
    let mean = periods.iter().sum::<f64>() / periods.len() as f64;
    // A busy machine leaves frames out, so that some periods may be twice as long.
    assert!(mean > 0.9 && periods.iter().any(|period| (0.8..1.2).contains(period)), "periods: {periods:?}");
}

fn results_in_order(results: &Heard) -> u64 {
    let Some(Message::Detections(array)) = results.next(Duration::from_secs(30)) else { panic!("no frame") };
    array.header.stamp.as_ns()
}

/// Each rate takes effect at once, also after a period that is longer than anybody would wait.
#[test]
fn a_slow_rate_is_made_fast() {
    let bench = Bench::new();
    let fixed = "source:=scene://glare?width=96&height=64 model:=% engine:=rten loop:=true rate:=20";
    let _running = bench.starts(&format!("launch launch/raw.launch.yaml {fixed}"));
    let peer = Peer::new(&bench);
    let results = peer.hear("/detector/detections", MessageKind::Detections);
    wait_until("the first frame is answered", || results.next(Duration::from_secs(1)).is_some());
    for slow in ["0.01", "1e-6"] {
        for fast in ["20.0", "0.0"] {
            peer.set("/modulo_camera", "rate", slow).expect("possible");
            peer.set("/modulo_camera", "rate", fast).expect("possible");
            next_stamp(&results, &format!("rate {slow}, {fast}"));
        }
    }
}

fn declared(node: &str) -> Vec<Descriptor> {
    match node {
        "modulo_camera" => modulo_camera::CameraParameters::descriptors(),
        "unwrap" => modulo_unwrap::UnwrapParameters::descriptors(),
        _ => modulo_detector::DetectorParameters::descriptors(),
    }
}

/// A node that takes its arguments waits in vain for a node that is not there; one that refuses them ends with 2 before.
#[test]
fn a_node_refuses_a_bad_argument_in_a_sentence() {
    let bench = Bench::new();
    let all = NODES.iter().zip(["topic:/modulo", "/recovered", "/detector/annotated"]).flat_map(
        |(node, own_topic)| {
            let values = hostile(&bench, own_topic);
            let pairs = declared(node).into_iter().flat_map(move |descriptor| {
                values.clone().into_iter().map(move |value| (descriptor.clone(), value))
            });
            pairs.map(move |(descriptor, value)| (*node, descriptor, value))
        },
    );
    let queue = Mutex::new(all.collect::<Vec<_>>().into_iter());
    let work = || {
        let mut refused = 0;
        // A function of its own: the lock is free again while the node runs.
        let next = || queue.lock().expect("not poisoned").next();
        while let Some((node, descriptor, value)) = next() {
            refused += u32::from(is_refused(&bench, node, &descriptor, &value));
        }
        refused
    };
    let refused = std::thread::scope(|scope| {
        let workers = [(); 2].map(|()| scope.spawn(work));
        workers.into_iter().map(|worker| worker.join().expect("no panic")).sum::<u32>()
    });
    assert!(refused > 300, "{refused}");
}

/// Starts `node` with a value; returns whether it refuses it.
fn is_refused(bench: &Bench, node: &str, descriptor: &Descriptor, value: &str) -> bool {
    // A text is given in quotes, as in a shell.
    let value = match descriptor.default {
        Value::String(_) => format!("'{value}'"),
        _ => value.to_owned(),
    };
    let set = format!("{}:={value}", descriptor.name);
    let model = format!("model:={}", model());
    let mut arguments =
        vec!["run", node, "--ros-args", "-p", "wait_for:=[nobody]", "-p", "wait_timeout:=0.0"];
    let needed = [
        ("detector", model.as_str()),
        ("detector", "engine:=rten"),
        ("modulo_camera", "source:=scene://glare"),
    ];
    for (_, argument) in needed.iter().filter(|(of, _)| *of == node) {
        arguments.extend(["-p", argument]);
    }
    arguments.extend(["-p", &set]);
    let output = bench.run(&arguments);
    let (printed, shown) = (text(&output), set.chars().take(60).collect::<String>());
    match output.status.code() {
        Some(2) => assert!(printed.contains(descriptor.name), "{node} {shown}: {printed}"),
        Some(1) => assert!(printed.contains("/nobody"), "{node} {shown}: {printed}"),
        code => panic!("{node} {shown}: {code:?}, {printed}"),
    }
    output.status.code() == Some(2)
}

/// A value that a launch argument cannot have ends the launch with 2 and names it; any other one makes a run.
#[test]
fn a_launch_refuses_a_bad_argument() {
    let bench = Bench::new();
    let shown = bench.says(0, "launch launch/recovered.launch.yaml --show-args");
    let names: Vec<&str> =
        shown.lines().filter_map(|line| line.split_once(" (default")).map(|(name, _)| name).collect();
    assert!(names.len() > 20, "{shown}");
    for name in names.iter().filter(|name| !name.starts_with(' ')) {
        // Names of nodes are no values: `a b` is refused for them by the launch itself.
        let (set, model) = (format!("{name}:=a b"), format!("model:={}", model()));
        let fixed = ["source:=scene://glare?width=96&height=64", "frames:=1", "engine:=rten", &model];
        let fixed = fixed.iter().filter(|argument| !argument.starts_with(&format!("{name}:=")));
        let mut arguments = vec!["launch", "launch/recovered.launch.yaml", &set];
        arguments.extend(fixed);
        assert_has(&bench.ends(2, &arguments), &["a b"]);
    }
}
