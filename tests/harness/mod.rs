//! Runs the shipped binary as a user would, each test in a ROS domain of its own, and [`Peer`]: a ROS node in the process
//! of the test.

#![allow(dead_code, reason = "each test binary uses its part")]

pub mod data;
pub mod encoder;
mod live;
pub mod readings;

pub use live::{Domain, wait_until};

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use modulo_middleware::parameter::client::ParameterClient;
use modulo_middleware::transport::queue::{Keep, Limit, Queue};
use modulo_middleware::transport::zenoh::{RawPublisher, ZenohTransport};
use modulo_middleware::transport::{Guard, Incoming, Publisher, RawSample, Transport};
use modulo_runtime::wire::keys::{Endpoint, EntityKind, Hashes, qos_string};
use modulo_runtime::{Address, Clock, Message, MessageKind, NodeName, Qos, SystemClock, Topic};
use serde_json::Value;
use tempfile::TempDir;

/// The folder and the domain of one test.
pub struct Bench {
    /// Files of this test.
    pub folder: TempDir,
    pub domain: Domain,
}

impl Bench {
    pub fn new() -> Self {
        Self { folder: tempfile::tempdir().expect("a temporary folder"), domain: Domain::take() }
    }

    /// A path in the test's folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The binary with `arguments`, not started yet.
    pub fn modulo(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_modulo"));
        command
            .args(arguments)
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .env("ROS_DOMAIN_ID", self.domain.id.to_string())
            // A variable of the shell that runs the tests would change what they see.
            .env_remove("MODULO_REPORT_DIR")
            .env_remove("MODULO_STATE_DIR")
            .env_remove("MODULO_TRACE_DIR")
            .env_remove("MODULO_LAUNCHER_PID")
            .env_remove("ZENOH_SESSION_CONFIG_URI")
            .env_remove("ZENOH_CONFIG_OVERRIDE")
            .env_remove("RUST_LOG")
            .stdin(Stdio::null());
        command
    }

    /// Runs it to its end.
    pub fn run(&self, arguments: &[&str]) -> Output {
        self.modulo(arguments).output().expect("the binary starts")
    }

    /// Runs it to its end, which must have this exit code. Returns all that it prints.
    #[track_caller]
    pub fn ends(&self, code: i32, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let message = text(&output);
        assert_eq!(output.status.code(), Some(code), "modulo {}\n{message}", arguments.join(" "));
        message
    }

    /// The words of a command line, in which `@` stands for the folder of the test, and `%` for [`model`].
    pub fn words(&self, line: &str) -> Vec<String> {
        let (folder, model) = (self.folder.path().display().to_string(), model());
        line.split_whitespace().map(|word| word.replace('@', &folder).replace('%', &model)).collect()
    }

    /// Does what `ends` does, with the [`words`](Self::words) of a line.
    #[track_caller]
    pub fn says(&self, code: i32, line: &str) -> String {
        self.ends(code, &borrowed(&self.words(line)))
    }

    /// Does what `start` does, with the [`words`](Self::words) of a line.
    pub fn starts(&self, line: &str) -> Background {
        self.start(&borrowed(&self.words(line)))
    }

    /// A JSON file of the test's folder.
    pub fn json(&self, name: &str) -> Value {
        json(&self.path(name))
    }

    /// Starts it in the background, with the `RUST_LOG` that rmw_zenoh sets in all that `ros2 launch` starts.
    pub fn start(&self, arguments: &[&str]) -> Background {
        let child = self
            .modulo(arguments)
            .env("RUST_LOG", "warn")
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        Background(child.expect("the binary starts"))
    }

    /// Starts a recording into `bag`, and waits until the bag is there.
    pub fn record(&self, bag: &Path, arguments: &[&str]) -> Background {
        let all = [&["bag", "record", "-o", bag.to_str().expect("UTF-8")], arguments].concat();
        // The few lines of the recorder fit into the pipe, so that nothing has to read them before the end.
        let child = self.modulo(&all).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let recording = Background(child.expect("the binary starts"));
        wait_until("the bag's folder is there", || bag.is_dir());
        recording
    }

    /// `count` small images with a bright square that moves.
    pub fn images(&self, count: u32) -> PathBuf {
        let folder = self.path("images");
        std::fs::create_dir_all(&folder).expect("a writable folder");
        for number in 0..count {
            let image = image::RgbImage::from_fn(96, 64, |x, y| {
                let inside = (x.wrapping_sub(10 + 3 * number) < 20) && (20..40).contains(&y);
                let shade = (x + y) as u8;
                if inside { image::Rgb([shade + 60, shade + 80, shade]) } else { image::Rgb([shade; 3]) }
            });
            image.save(folder.join(format!("{number:06}.png"))).expect("a writable folder");
        }
        folder
    }
}

/// Returns `command` as a shell starts it after `script`, such as a redirection.
pub fn in_shell(command: &Command, script: &str) -> Command {
    let mut shell = Command::new("sh");
    shell
        .args(["-c", &format!("{script}; exec \"$@\""), "sh"])
        .arg(command.get_program())
        .args(command.get_args());
    shell.current_dir(command.get_current_dir().unwrap_or(Path::new("."))).stdin(Stdio::null());
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => shell.env(name, value),
            None => shell.env_remove(name),
        };
    }
    shell
}

pub fn borrowed(words: &[String]) -> Vec<&str> {
    words.iter().map(String::as_str).collect()
}

/// A process that is ended with the test.
pub struct Background(pub Child);

impl Background {
    /// Sends SIGINT and waits for the end.
    pub fn interrupt(self) -> Option<i32> {
        self.end("INT").0
    }

    /// Sends a signal and waits for the end: exit code, and standard output where it is kept.
    pub fn end(mut self, name: &str) -> (Option<i32>, String) {
        signal(self.0.id(), name);
        let code = self.0.wait().expect("it ends").code();
        let out = self.0.stdout.take().map(std::io::read_to_string);
        (code, out.transpose().expect("UTF-8").unwrap_or_default())
    }

    /// Waits for the end: exit code, and standard error, which must be piped.
    pub fn errors(mut self) -> (Option<i32>, String) {
        let errors = self.0.stderr.take().map(std::io::read_to_string);
        let errors = errors.expect("standard error is piped").expect("UTF-8");
        (self.0.wait().expect("it ends").code(), errors)
    }

    /// Process ids of its children, each with its command line.
    pub fn children(&self) -> Vec<(u32, String)> {
        let parent = format!("PPid:\t{}", self.0.id());
        let all = std::fs::read_dir("/proc").expect("/proc is there").flatten();
        let all = all.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
        let is_child = |pid: &u32| {
            let status = std::fs::read_to_string(format!("/proc/{pid}/status"));
            status.is_ok_and(|status| status.lines().any(|line| line == parent))
        };
        all.filter(is_child).map(|pid| (pid, command_line(pid))).collect()
    }

    /// Process id of the node of this launcher that is of this kind.
    pub fn node(&self, kind: &str) -> Option<u32> {
        let of_kind = |line: &str| line.contains(&format!(" run {kind} "));
        self.children().into_iter().find(|(_, line)| of_kind(line)).map(|(pid, _)| pid)
    }
}

/// Returns the command line of a process; empty where it has ended.
pub fn command_line(pid: u32) -> String {
    std::fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default().replace('\0', " ")
}

/// Sends the signal called `name`.
pub fn signal(pid: u32, name: &str) {
    let sent = Command::new("kill").args([&format!("-{name}"), &pid.to_string()]).status();
    assert!(sent.is_ok_and(|status| status.success()), "process {pid} is there");
}

impl Drop for Background {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The small model of the detector's own tests: boxes that depend on the image.
pub fn model() -> String {
    format!("{}/nodes/detector/tests/data/rows.onnx", env!("CARGO_MANIFEST_DIR"))
}

/// `name:=value`.
pub fn arg(name: &str, value: impl AsRef<Path>) -> String {
    format!("{name}:={}", value.as_ref().display())
}

/// Standard output and error as text.
pub fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// Checks that a text has each of `parts`.
#[track_caller]
pub fn assert_has(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "no {part:?} in\n{text}");
    }
}

/// A JSON file.
pub fn json(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).unwrap_or_else(|why| panic!("{}: {why}", path.display()));
    serde_json::from_str(&text).expect("JSON")
}

/// Detections by class of one stream of a summary.
pub fn classes(summary: &Value, stream: &str) -> BTreeMap<String, u64> {
    let classes = summary["detections"][stream].as_object().cloned().unwrap_or_default();
    classes.into_iter().map(|(class, n)| (class, n.as_u64().expect("a count"))).collect()
}

/// The cell of a stream in the results of an evaluation.
pub fn cell(folder: &Path, stream: &str) -> Value {
    let results = json(&folder.join("results.json"));
    let mut cells = results["cells"].as_array().expect("cells").iter();
    cells.find(|cell| cell["stream"] == stream).unwrap_or_else(|| panic!("{stream}: {results}")).clone()
}

/// The frames of a stream as an evaluation has stored them, in their order.
pub fn evaluated(folder: &Path, stream: &str) -> Vec<Value> {
    let files =
        std::fs::read_dir(folder.join("cells")).expect("cells").map(|file| file.expect("a file").path());
    let slices =
        files.filter(|file| file.extension().is_some_and(|ending| ending == "json")).map(|file| json(&file));
    let own = slices.filter(|slice| slice["key"]["point"]["stream"] == stream);
    let mut frames: Vec<Value> =
        own.flat_map(|slice| slice["frames"].as_array().expect("frames").clone()).collect();
    frames.sort_by_key(|frame| frame["place"].as_u64());
    frames
}

/// Detections by class of a stream of an evaluation, those that a launch shows.
pub fn evaluated_classes(folder: &Path, stream: &str) -> BTreeMap<String, u64> {
    let mut classes = BTreeMap::new();
    for found in evaluated(folder, stream).iter().flat_map(|frame| frame["boxes"].as_array().expect("boxes"))
    {
        if found[1].as_f64().expect("a score") >= 0.25 {
            *classes.entry(found[2].as_str().expect("a class").to_owned()).or_insert(0) += 1;
        }
    }
    classes
}

/// A node `/peer` on the domain of a bench.
pub struct Peer {
    pub transport: ZenohTransport,
    pub node_name: NodeName,
    _announced: Guard,
}

/// The messages that arrive on a topic.
pub struct Heard {
    kind: MessageKind,
    queue: Arc<Queue<Incoming>>,
    _subscription: Guard,
}

impl Peer {
    pub fn new(bench: &Bench) -> Self {
        Self::with_hashes(bench, Hashes::Rihs01)
    }

    pub fn with_hashes(bench: &Bench, hashes: Hashes) -> Self {
        let clock: Arc<dyn Clock> = Arc::new(SystemClock::default());
        let transport = ZenohTransport::open(bench.domain.id, hashes, clock).expect("a session on loopback");
        let node_name = NodeName::new("peer", "/", &[]).expect("a name");
        let announced = transport.announce(&node_name).expect("a token");
        Self { transport, node_name, _announced: announced }
    }

    pub fn advertise(&self, topic: &str, kind: MessageKind) -> Box<dyn Publisher> {
        self.transport.advertise(&self.node_name, &address(topic, kind)).expect("a publisher")
    }

    /// A publisher of any bytes on `topic`.
    pub fn advertise_raw(&self, topic: &str, kind: MessageKind) -> RawPublisher {
        self.transport.advertise_raw(&self.node_name, &endpoint(topic, kind)).expect("a publisher")
    }

    /// Samples on `topic` as they come.
    pub fn listen(&self, topic: &str, kind: MessageKind) -> (Guard, Receiver<RawSample>) {
        let endpoint = endpoint(topic, kind);
        let (samples, arrived) = channel();
        let take = move |sample| drop(samples.send(sample));
        (self.transport.subscribe_raw(&self.node_name, &endpoint, take).expect("a subscription"), arrived)
    }

    /// The fully qualified names of the nodes that subscribe to `topic` now.
    pub fn subscribers(&self, topic: &str) -> Vec<String> {
        let endpoints = self.transport.endpoints(EntityKind::Subscription, topic);
        endpoints.into_iter().map(|node| node.name).collect()
    }

    /// Sets a parameter of `node` to the value that `text` has in YAML; the error is the reason of the refusal.
    pub fn set(&self, node: &str, name: &str, text: &str) -> Result<(), String> {
        ParameterClient::new(&self.transport, node).set(name, text).map_err(|why| why.to_string())
    }

    pub fn hear(&self, topic: &str, kind: MessageKind) -> Heard {
        self.hear_as(topic, kind, Qos::usual(kind))
    }

    /// Does the same as `hear`, with another quality of service than usual for this kind.
    pub fn hear_as(&self, topic: &str, kind: MessageKind, qos: Qos) -> Heard {
        let clock = Arc::new(SystemClock::default());
        let queue = Arc::new(Queue::new(clock, Limit { messages: 0, bytes: 0 }));
        let (waiting, lane) = (queue.clone(), queue.open(Keep::Last(1000)));
        let deliver = Box::new(move |incoming| drop(waiting.push(lane, incoming)));
        let subscription = self
            .transport
            .subscribe(&self.node_name, &Address { qos, ..address(topic, kind) }, deliver)
            .expect("a subscription");
        Heard { kind, queue, _subscription: subscription }
    }
}

fn endpoint(topic: &str, kind: MessageKind) -> Endpoint {
    let Address { topic, qos, .. } = address(topic, kind);
    let dds_type = modulo_msgs::dds_name(kind.type_name());
    Endpoint { topic, dds_type, type_hash: kind.type_hash(), qos: qos_string(qos).into() }
}

fn address(topic: &str, kind: MessageKind) -> Address {
    let Topic { name, kind, qos, .. } = Topic::new(topic, kind);
    Address { topic: name, kind, qos, profile: None }
}

impl Heard {
    /// The next message within `patience`.
    pub fn next(&self, patience: Duration) -> Option<Message> {
        let incoming = self.queue.take(Some(patience))?.item;
        Some(incoming.open(self.kind).expect("a message of its kind"))
    }

    /// The first message for which `wanted` holds.
    pub fn until(&self, what: &str, wanted: impl Fn(&Message) -> bool) -> Message {
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(30) {
            if let Some(message) = self.next(Duration::from_millis(100))
                && wanted(&message)
            {
                return message;
            }
        }
        panic!("waited in vain: {what}");
    }
}
