//! What the suite's transport costs above raw zenoh: 1.4 MB images at 30 Hz between two processes, both ways in the
//! same run, over TCP and over shared memory.
//!
//!     cargo run --release -p modulo-runtime --example transport_cost -- [SECONDS]
//!
//! Ours is a `Message::Image` into the publisher until its bytes are out of the inbox, and until it is a `Frame` again;
//! raw is the same pixels into a buffer and into zenoh's `put` until the bytes are out of zenoh's channel. Both
//! sessions have the same queues. Fails when a frame of ours is lost or the reader's memory grows by more than 20 %
//! after the first tenth of the run.

use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use modulo_core::Frame;
use modulo_middleware::transport::Transport;
use modulo_middleware::transport::queue::{Keep, Limit, Queue};
use modulo_middleware::transport::zenoh::ZenohTransport;
use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::wire::keys::Hashes;
use modulo_runtime::{Address, Clock, Message, MessageKind, NodeName, Qos, StampedFrame, SystemClock};
use ndarray::Array3;
use zenoh::qos::{CongestionControl, Reliability};
use zenoh::{Session, Wait};

const DOMAIN: u32 = 231;
const SHAPE: (usize, usize, usize) = (375, 1242, 3);
const PERIOD: Duration = Duration::from_nanos(1_000_000_000 / 30);
const RAW_KEY: &str = "raw/images";
const RAW_PORT: u16 = 7449;
/// Frames before the first that counts: connections, first allocations.
const WARM_UP: usize = 30;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["send", seconds] => send(frames_of(seconds)),
        ["receive", seconds, carrier] => receive(frames_of(seconds), carrier),
        ["--help" | "-h", ..] => println!("transport_cost [SECONDS]"),
        [seconds] => compare(seconds),
        _ => compare("20"),
    }
}

fn frames_of(seconds: &str) -> usize {
    let seconds: f64 = seconds.parse().expect("SECONDS is a number");
    (seconds * 30.0) as usize + WARM_UP
}

/// Two processes a carrier.
fn compare(seconds: &str) {
    println!("carrier  what     frames  lost   p50 ms   p99 ms   ratio of p50");
    for (carrier, enabled) in [("tcp", false), ("shm", true)] {
        let start = |arguments: &[&str]| -> Child {
            Command::new(std::env::current_exe().expect("a path"))
                .args(arguments)
                .env("ZENOH_CONFIG_OVERRIDE", format!("transport/shared_memory/enabled={enabled}"))
                .stdin(Stdio::null())
                .spawn()
                .expect("a process")
        };
        let mut reader = start(&["receive", seconds, carrier]);
        let mut sender = start(&["send", seconds]);
        let ended = reader.wait().expect("it ends");
        // The sender waits after its last frame, so that none is lost with its session.
        sender.kill().expect("it is ours");
        sender.wait().expect("it ends");
        assert!(ended.success(), "{carrier}: the reader failed");
    }
}

fn ours() -> (ZenohTransport, NodeName, Address) {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock::default());
    let transport = ZenohTransport::open(DOMAIN, Hashes::Rihs01, clock).expect("a session");
    let node_name = NodeName::new("cost", "/", &[]).expect("a name");
    let address =
        Address { topic: "/images".into(), kind: MessageKind::Image, qos: Qos::Images, profile: None };
    (transport, node_name, address)
}

fn raw(endpoints: &str) -> Session {
    let mut config = zenoh::Config::default();
    // The raw session has no configuration of the suite, so it takes the same override by hand.
    let shared = std::env::var("ZENOH_CONFIG_OVERRIDE").expect("the parent sets it");
    let shared = shared.split_once('=').expect("key=value").1.to_owned();
    for (key, value) in [
        ("mode", "\"peer\""),
        (endpoints, &format!("[\"tcp/127.0.0.1:{RAW_PORT}\"]")),
        ("connect/exit_on_failure", "false"),
        ("connect/timeout_ms", "-1"),
        ("scouting/multicast/enabled", "false"),
        ("timestamping/enabled", "true"),
        ("transport/shared_memory/enabled", &shared),
        ("transport/link/tx/queue/size/data", "16"),
        ("transport/link/tx/queue/congestion_control/drop/wait_before_drop", "20000"),
        ("transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments", "200000"),
    ] {
        config.insert_json5(key, value).expect("a known key");
    }
    zenoh::open(config).wait().expect("a session")
}

/// Alternates between the two, half a period apart, until it is killed.
fn send(frames: usize) {
    let clock = SystemClock::default();
    let (transport, node_name, address) = ours();
    let publisher = transport.advertise(&node_name, &address).expect("a publisher");
    let session = raw("connect/endpoints");
    let raw_publisher = session
        .declare_publisher(RAW_KEY)
        .congestion_control(CongestionControl::Drop)
        .reliability(Reliability::BestEffort)
        .wait()
        .expect("a publisher");
    // Both readers must be there, or the first frames of one carrier would go nowhere.
    while !publisher.wanted() || !raw_publisher.matching_status().wait().is_ok_and(|s| s.matching()) {
        std::thread::sleep(Duration::from_millis(10));
    }
    std::thread::sleep(Duration::from_millis(500));
    let pixels = Array3::from_shape_fn(SHAPE, |(i, j, c)| (i + j + c) as u8);
    let ready = pixels.as_slice().expect("packed").to_vec();
    let start = Instant::now();
    for number in 0..2 * frames as u32 {
        // By turns and half a period apart, so that both meet the same load of the machine and never each other.
        std::thread::sleep((PERIOD / 2 * number).saturating_sub(start.elapsed()));
        if number % 2 == 0 {
            let frame = Frame::from_u8(pixels.clone()).expect("a frame");
            let header = Header { stamp: Time::from_ns(clock.now_ns()), frame_id: "camera".into() };
            publisher.put(&Message::Image(Arc::new(StampedFrame { header, frame }))).expect("sent");
        } else {
            let sent = clock.now_ns();
            // A copy, as a node makes one for its message.
            let mut payload = ready.clone();
            payload[..8].copy_from_slice(&sent.to_le_bytes());
            raw_publisher.put(payload).wait().expect("sent");
        }
    }
    std::thread::sleep(Duration::from_secs(3600));
}

fn receive(frames: usize, carrier: &str) {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock::default());
    let (transport, node_name, address) = ours();
    let session = raw("listen/endpoints");
    let arrived = raw_latencies(&session, clock.clone());
    let queue = Arc::new(Queue::new(clock.clone(), Limit { messages: 0, bytes: 0 }));
    let (waiting, lane) = (queue.clone(), queue.open(Keep::Last(30)));
    let deliver = Box::new(move |incoming| drop(waiting.push(lane, incoming)));
    let _subscription = transport.subscribe(&node_name, &address, deliver).expect("a subscription");
    let (mut bytes, mut pixels, mut early) = (Vec::new(), Vec::new(), 0.0);
    while let Some(incoming) = queue.take(Some(Duration::from_secs(5))).map(|arrived| arrived.item) {
        // Taken before the message is decoded: the first latency is that of the bytes, the second that of the pixels.
        let there = clock.now_ns();
        let Ok(Message::Image(image)) = incoming.open(MessageKind::Image) else { panic!("an image") };
        assert_eq!(image.frame.dim(), SHAPE);
        let sent = image.header.stamp.as_ns();
        bytes.push((there - sent) as f64 / 1e6);
        pixels.push((clock.now_ns() - sent) as f64 / 1e6);
        // By then all buffers have their size, so that later growth is a leak.
        if bytes.len() == frames / 10 + WARM_UP {
            early = resident_mib();
        }
        if bytes.len() == frames {
            break;
        }
    }
    let late = resident_mib();
    std::thread::sleep(Duration::from_millis(200));
    let lost = frames - bytes.len();
    print(frames, carrier, arrived.try_iter().collect(), bytes, pixels);
    println!("{carrier:<8} reader's memory {early:.1} MiB -> {late:.1} MiB");
    assert_eq!(lost as u64 + queue.counts(lane).lost(), 0, "frames of ours were lost");
    assert!(late <= 1.2 * early, "memory grew from {early} to {late} MiB");
}

/// Returns the latencies in ms of the frames that zenoh alone brings, as they come.
fn raw_latencies(session: &zenoh::Session, clock: Arc<dyn Clock>) -> Receiver<f64> {
    let raw = session.declare_subscriber(RAW_KEY).wait().expect("a subscriber");
    let (sender, arrived) = channel();
    std::thread::spawn(move || {
        while let Ok(sample) = raw.recv() {
            let bytes = sample.payload().to_bytes();
            let sent = u64::from_le_bytes(bytes[..8].try_into().expect("8 bytes"));
            if sender.send((clock.now_ns() - sent) as f64 / 1e6).is_err() {
                return;
            }
        }
    });
    arrived
}

/// Prints a row for each way to carry the frames, with latencies in ms.
fn print(frames: usize, carrier: &str, raw: Vec<f64>, bytes: Vec<f64>, pixels: Vec<f64>) {
    let base = quantiles(raw.clone()).0;
    for (what, latencies) in [("raw", raw), ("ours", bytes), ("as Frame", pixels)] {
        let (got, (p50, p99)) = (latencies.len(), quantiles(latencies));
        println!(
            "{carrier:<8} {what:<8} {got:>6} {:>5} {p50:>8.3} {p99:>8.3} {:>14.3}",
            frames - got,
            p50 / base
        );
    }
}

/// Median and 99 % of all but the first.
fn quantiles(mut latencies: Vec<f64>) -> (f64, f64) {
    latencies.drain(..WARM_UP.min(latencies.len()));
    assert!(!latencies.is_empty(), "nothing arrived");
    latencies.sort_by(f64::total_cmp);
    let at = |q: f64| latencies[((latencies.len() - 1) as f64 * q) as usize];
    (at(0.5), at(0.99))
}

/// Resident memory of this process.
fn resident_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kib = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<f64>().ok());
    kib.unwrap_or(f64::NAN) / 1024.0
}
