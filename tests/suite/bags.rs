//! Bags of the shipped binary: they are recorded, cut by a crash, split, replayed, and controlled by services.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime};

use modulo_middleware::transport::zenoh::{RawPublisher, RawService, ZenohTransport};
use modulo_middleware::transport::{Guard, Publisher as _, RawSample, Transport};
use modulo_runtime::wire::keys::{self, Endpoint, EntityKind, Hashes, Token};
use modulo_runtime::{MessageKind, NodeName, Qos, SystemClock};

use crate::harness::{Background, Bench, Peer, assert_has, in_shell, signal, text, wait_until};
use modulo_bags::bag::{BagReader, BagTopic, BagWriter, Compression, Selection};
use modulo_msgs::builtin_interfaces::Time;
use modulo_msgs::rosbag2_interfaces as player;
use modulo_msgs::{cdr, rosgraph_msgs};

const IMAGE: &str = "sensor_msgs/msg/Image";
/// When the bags here begin, ns since the epoch.
const START: u64 = 1_700_000_000_000_000_000;
const MS: u64 = 1_000_000;

/// A bag of `count` messages on /data, `every` ms apart, each `length` bytes with its number in front.
fn write_bag(path: &Path, count: u32, every: u64, length: usize) {
    let mut bag = BagWriter::create(path, Compression::None).expect("a new bag");
    let topic = bag.topic(&BagTopic::new("/data", IMAGE, Qos::Images)).expect("a topic");
    for number in 0..count {
        let mut payload = vec![0; length.max(8)];
        payload[4..8].copy_from_slice(&number.to_le_bytes());
        let time = START + u64::from(number) * every * MS;
        bag.write(topic, time, time, &payload).expect("writable");
    }
    bag.finish().expect("writable");
}

fn number(payload: &[u8]) -> u32 {
    u32::from_le_bytes(payload[4..8].try_into().expect("4 bytes"))
}

/// (log time, number) of all messages on /data.
fn numbers(bag: &Path) -> Vec<(u64, u32)> {
    let bag = BagReader::open(bag).expect("a bag");
    let messages = bag.messages(&Selection::of(["/data"])).map(|m| m.expect("readable"));
    messages.map(|m| (m.log_time, number(&m.data))).collect()
}

fn utf8(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// The place of a topic in the graph. A type that the suite does not know has a hash of zeros.
fn endpoint(topic: &str, type_name: &str, qos: Qos) -> Endpoint {
    Endpoint {
        topic: topic.into(),
        dds_type: modulo_msgs::dds_name(type_name),
        type_hash: modulo_msgs::type_hash(type_name).unwrap_or_else(|| format!("RIHS01_{:064}", 0)),
        qos: keys::qos_string(qos).into(),
    }
}

fn node(name: &str) -> NodeName {
    NodeName { name: name.into(), namespace: "/".into(), remaps: Vec::new() }
}

/// A client of `/rosbag2_player`.
struct Remote {
    transport: ZenohTransport,
}

impl Remote {
    fn new(domain: u32) -> Self {
        Self {
            transport: ZenohTransport::open(domain, Hashes::Rihs01, Arc::new(SystemClock::default()))
                .expect("a session"),
        }
    }

    fn call(&self, name: &str, request: Vec<u8>) -> Vec<u8> {
        let service = format!("/rosbag2_player/{}", snake(name));
        let ros_type = format!("rosbag2_interfaces/srv/{name}");
        self.transport.call(&service, &ros_type, request, Duration::from_secs(10)).expect("answered")
    }

    /// Subscribes to `topic`.
    fn listen(&self, topic: &str, type_name: &str, qos: Qos) -> (Guard, Receiver<RawSample>) {
        let (samples, arrived) = channel();
        let take = move |sample| drop(samples.send(sample));
        let endpoint = endpoint(topic, type_name, qos);
        (self.transport.subscribe_raw(&node("listener"), &endpoint, take).expect("a subscription"), arrived)
    }
}

/// Calls a service of the player and reads its response.
macro_rules! call {
    ($remote:expr, $name:literal, $request:expr) => {
        cdr::from_slice(&$remote.call($name, cdr::to_vec(&$request).expect("short"))).expect("a response")
    };
}

/// `PlayNext` as `play_next`.
fn snake(name: &str) -> String {
    let mut text = String::new();
    for c in name.chars() {
        if c.is_ascii_uppercase() && !text.is_empty() {
            text.push('_');
        }
        text.push(c.to_ascii_lowercase());
    }
    text
}

/// Plays `bag` to its end, from when the recorder has subscribed to its topic.
fn play(bench: &Bench, bag: &Path, arguments: &[&str]) {
    let mut playing = bench.start(&[&["bag", "play", utf8(bag), "--start-paused"], arguments].concat());
    let remote = Remote::new(bench.domain.id);
    wait_until("the recorder reads /data", || {
        let graph = remote.transport.graph();
        let mut readers = graph.endpoints(EntityKind::Subscription, "/data").map(Token::node_name);
        graph.has_node("/rosbag2_player") && readers.any(|node| node == "/rosbag2_recorder")
    });
    let _: player::ResumeResponse = call!(remote, "Resume", player::ResumeRequest::default());
    assert_eq!(playing.0.wait().expect("it ends").code(), Some(0));
}

/// A topic that ROS 2 does not allow must not keep the others from being played.
#[test]
fn a_topic_that_cannot_be_offered_is_left_out_and_named() {
    let bench = Bench::new();
    let path = bench.path("bag");
    let mut bag = BagWriter::create(&path, Compression::None).expect("a new bag");
    let own = BagTopic { name: "/own".into(), type_name: "a/msg/B".into(), ..BagTopic::default() };
    for topic in [
        BagTopic::new("/device_0/Auto Exposure/value", "std_msgs/msg/String", Qos::Results),
        // As the Python package `mcap` writes it.
        BagTopic { type_hash: String::new(), ..BagTopic::new("/ok/image", IMAGE, Qos::Images) },
        own,
        BagTopic::new("/2nd//image", IMAGE, Qos::Images),
    ] {
        let topic = bag.topic(&topic).expect("a topic");
        bag.write(topic, START, START, &[0, 1, 0, 0]).expect("writable");
    }
    bag.finish().expect("writable");
    let play =
        |code, arguments: &[&str]| bench.ends(code, &[&["bag", "play", utf8(&path)], arguments].concat());
    let message = play(3, &[]);
    let parts = [
        "'/device_0/Auto Exposure/value' is left out",
        "--remap '/device_0/Auto Exposure/value:=/NAME'",
        "--topics",
        "'/2nd//image' is left out",
        "topic '/own' is found only by readers without type hashes",
        "/ok/image: 1 messages",
    ];
    assert_has(&message, &parts);
    let message = play(0, &["--topics", "/ok/image"]);
    assert!(message.contains("/ok/image: 1 messages") && !message.contains("left out"), "{message}");

    let remote = Remote::new(bench.domain.id);
    let (_exposure, exposures) = remote.listen("/exposure", "std_msgs/msg/String", Qos::Results);
    let (_image, images) = remote.listen("/ok/image", IMAGE, Qos::Images);
    let rules = ["/device_0/Auto Exposure/value:=/exposure", "2nd//image:=/second"];
    // The type of /own has no hash.
    let message = play(3, &["--remap", rules[0], rules[1]]);
    assert!(!message.contains("left out"), "{message}");
    for samples in [exposures, images] {
        samples.recv_timeout(Duration::from_secs(10)).expect("heard");
    }
    assert_has(&play(2, &["--remap", "/ok/image:=/b c"]), &["'/b c' is not a ROS name"]);
}

#[test]
fn a_killed_recorder_keeps_all_but_its_last_second() {
    let bench = Bench::new();
    let source = bench.path("source");
    write_bag(&source, 40, 50, 100_000);

    // Killed while messages come.
    let (bag, saved) = (bench.path("killed"), bench.path("saved"));
    let recorder = bench.record(&bag, &[]);
    let playing = bench.start(&["bag", "play", utf8(&source), "--loop", "--wait-for", "/rosbag2_recorder"]);
    let file = bag.join("killed_0.mcap");
    wait_until("four seconds of messages", || std::fs::metadata(&file).is_ok_and(|f| f.len() > 8_000_000));
    let killed = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).expect("after 1970");
    assert_eq!(recorder.end("KILL").0, None);
    drop(playing);
    // The end is lost.
    bench.says(3, "bag recover @/killed @/saved");
    let kept = numbers(&saved);
    // The bag has 40 messages and is played in a loop: any gap breaks the order of the numbers.
    assert!(kept.windows(2).all(|pair| pair[1].1 == (pair[0].1 + 1) % 40), "{kept:?}");
    let last = Duration::from_nanos(kept.last().expect("messages").0);
    let lost = killed.saturating_sub(last);
    // A chunk is written each second; the limit leaves room for a busy machine.
    assert!(lost < Duration::from_secs(3), "{lost:?} before the kill are lost");

    // Killed in a pause: a second after the last message nothing is missing.
    let (bag, saved) = (bench.path("paused"), bench.path("all"));
    let recorder = bench.record(&bag, &[]);
    play(&bench, &source, &["--rate", "4"]);
    let mut tries = 0;
    wait_until("all messages are in the file", || {
        tries += 1;
        let copy = bench.path(&format!("copy_{tries}"));
        bench.run(&["bag", "recover", utf8(&bag), utf8(&copy)]);
        numbers(&copy).len() == 40
    });
    recorder.end("KILL");
    bench.run(&["bag", "recover", utf8(&bag), utf8(&saved)]);
    assert_eq!(numbers(&saved).iter().map(|n| n.1).collect::<Vec<_>>(), (0..40).collect::<Vec<_>>());
    assert!(BagReader::open(&saved).expect("a bag").warnings().is_empty());
}

#[test]
fn a_terminated_recorder_leaves_a_whole_bag_in_parts() {
    let bench = Bench::new();
    let (source, bag) = (bench.path("source"), bench.path("bag"));
    write_bag(&source, 30, 100, 1000);
    let recorder = bench.record(&bag, &["--all", "--max-bag-duration", "1", "--compression", "lz4"]);
    play(&bench, &source, &[]);
    let (code, message) = recorder.end("TERM");
    assert_eq!(code, Some(0), "{message}");
    assert!(message.contains("/data: 30 messages, 0 lost"), "{message}");
    let read = BagReader::open(&bag).expect("a bag");
    assert!(read.warnings().is_empty(), "{:?}", read.warnings());
    assert_eq!(read.files().count(), 3);
    assert_eq!(numbers(&bag).iter().map(|n| n.1).collect::<Vec<_>>(), (0..30).collect::<Vec<_>>());

    bench.says(2, "bag record -a /data -o @/both");

    // Converted: parts by size, the same messages.
    let small = bench.path("small");
    bench.says(0, "bag convert @/bag @/small --max-bag-size 4000");
    assert_eq!(numbers(&small), numbers(&bag));
    assert!(BagReader::open(&small).expect("a bag").files().count() >= 10);
    let info = bench.says(0, "bag info @/small");
    assert_has(&info, &["small_0.mcap\n                   small_1.mcap", "Messages:          30"]);
}

/// A terminal that is closed sends SIGHUP. A process under nohup ignores it from its start.
#[test]
fn a_recorder_whose_terminal_is_closed_leaves_a_whole_bag() {
    let bench = Bench::new();
    let (source, bag) = (bench.path("source"), bench.path("bag"));
    write_bag(&source, 3, 1, 1000);
    // The tests may run under nohup themselves.
    let mut command = Command::new("env");
    let of_bench = bench.modulo(&["bag", "record", "-o", utf8(&bag), "--all"]);
    command.args(["--default-signal=HUP".as_ref(), of_bench.get_program()]).args(of_bench.get_args());
    command.env("ROS_DOMAIN_ID", bench.domain.id.to_string()).stdin(Stdio::null()).stdout(Stdio::piped());
    let recorder = Background(command.spawn().expect("it starts"));
    play(&bench, &source, &[]);
    let (code, message) = recorder.end("HUP");
    assert_eq!(code, Some(0), "{message}");
    assert!(message.contains("/data: 3 messages, 0 lost"), "{message}");
    let read = BagReader::open(&bag).expect("a bag");
    assert!(read.warnings().is_empty() && read.message_count() == 3, "{:?}", read.warnings());
}

/// A service for definitions that does not answer until the other end of `forever` is dropped.
fn stalled(forever: Receiver<()>) -> RawService {
    let forever = Mutex::new(forever);
    let answer = Box::new(move |_: &[u8]| {
        let _ = forever.lock().map(|end| end.recv());
        Ok(Vec::new())
    });
    let ros_type = "type_description_interfaces/srv/GetTypeDescription";
    RawService { name: "get_type_description", ros_type, qos: keys::SERVICE_QOS, answer }
}

/// A topic whose type the suite does not know.
fn foreign(number: u32) -> Endpoint {
    endpoint(&format!("/foreign_{number}"), &format!("foreign_msgs/msg/Kind{number}"), Qos::Results)
}

/// Publishers of other packages may have a service for their definitions that does not answer.
#[test]
fn a_definition_that_nobody_gives_delays_no_other_topic_and_no_stop() {
    // At two seconds for each question, one after the other, the last topic would be subscribed after the test has given up.
    const TOPICS: u32 = 60;
    let bench = Bench::new();
    let (recorder, bag) = (Remote::new(bench.domain.id), bench.path("bag"));
    let node_name = node("foreign");
    let (give, forever) = channel();
    let transport = &recorder.transport;
    let _service = transport.serve_raw(&node_name, vec![stalled(forever)]).expect("a service");
    let advertise = |number| transport.advertise_raw(&node_name, &foreign(number)).expect("a publisher");
    let publishers: Vec<_> = (0..TOPICS).map(advertise).collect();
    let recording = bench.record(&bag, &["--all"]);
    wait_until("all topics are subscribed", || {
        let graph = transport.graph();
        let read = |topic: &String| graph.endpoints(EntityKind::Subscription, topic).next().is_some();
        (0..TOPICS).all(|number| read(&format!("/foreign_{number}")))
            && publishers.iter().all(RawPublisher::wanted)
    });
    // The recorder is ended while messages come, the first of which have arrived by then.
    for _ in 0..20 {
        for publisher in &publishers {
            publisher.put(cdr::to_vec(&7_u32).expect("short")).expect("sent");
        }
        sleep(Duration::from_millis(20));
    }
    let (code, message) = recording.end("INT");
    drop(give);
    assert_eq!(code, Some(0), "{message}");
    let read = BagReader::open(&bag).expect("a bag");
    let topics = read.topics();
    assert_eq!(topics.len(), TOPICS as usize, "{message}");
    assert!(topics.iter().all(|topic| topic.messages > 0), "{message}");
}

/// A file that cannot grow, as on a full disk: the recorder ends with the reason, and what it has flushed is a bag.
#[test]
fn a_recorder_on_a_full_disk_ends_with_the_reason() {
    let bench = Bench::new();
    let (source, bag) = (bench.path("source"), bench.path("bag"));
    write_bag(&source, 30, 20, 1_000_000);
    let recorder = bench.modulo(&["bag", "record", "-o", utf8(&bag), "/data"]);
    // The limit is in blocks of 512 bytes; without the trap, the kernel would end the process.
    let mut limited = in_shell(&recorder, "trap '' XFSZ; ulimit -f 24000");
    let limited = limited.stdout(Stdio::piped()).stderr(Stdio::piped());
    let recorder = limited.spawn().expect("a shell");
    wait_until("the bag's folder is there", || bag.is_dir());
    play(&bench, &source, &[]);
    let output = recorder.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert!(text(&output).contains("bag_0.mcap") && text(&output).contains("os error"), "{}", text(&output));
    let kept: Vec<_> = numbers(&bag).into_iter().map(|(_, number)| number).collect();
    assert!(!kept.is_empty() && kept.len() < 30 && kept.is_sorted(), "{kept:?}");
}

#[test]
fn what_a_recorder_lost_is_counted() {
    let bench = Bench::new();
    let (source, bag) = (bench.path("source"), bench.path("bag"));
    write_bag(&source, 60, 40, 1_000_000);
    let recorder = bench.record(&bag, &["/data"]);
    let remote = Remote::new(bench.domain.id);
    let (_data, sent) = remote.listen("/data", IMAGE, Qos::Images);
    std::thread::scope(|scope| {
        scope.spawn(|| play(&bench, &source, &[]));
        let file = bag.join("bag_0.mcap");
        wait_until("the first messages", || std::fs::metadata(&file).is_ok_and(|f| f.len() > 1_000_000));
        // While the process stands still, more than the queues on the way to it can hold is sent.
        signal(recorder.0.id(), "STOP");
        while number(&sent.recv_timeout(Duration::from_secs(30)).expect("a message").payload) < 30 {}
        signal(recorder.0.id(), "CONT");
    });
    let (code, message) = recorder.end("INT");
    assert_eq!(code, Some(3), "{message}");
    let kept = numbers(&bag);
    assert_eq!(kept.last().map(|n| n.1), Some(59), "the last message came, so every gap is seen");
    assert!(kept.len() < 60);
    assert_eq!(kept[0].1, 0);
    assert!(
        message.contains(&format!("/data: {} messages, {} lost", kept.len(), 60 - kept.len())),
        "{message}"
    );
}

#[test]
fn what_a_recorder_lost_at_the_end_is_counted() {
    let bench = Bench::new();
    let bag = bench.path("bag");
    let recorder = bench.record(&bag, &["/data"]);
    let remote = Remote::new(bench.domain.id);
    let endpoint = endpoint("/data", IMAGE, Qos::Images);
    let publisher = remote.transport.advertise_raw(&node("camera"), &endpoint).expect("a publisher");
    wait_until("the recorder", || publisher.wanted());
    let file = bag.join("bag_0.mcap");
    let put = || publisher.put(vec![0; 1_000_000]).expect("an open session");
    let mut sent = 0;
    wait_until("the first messages", || {
        put();
        sent += 1;
        sleep(Duration::from_millis(50));
        std::fs::metadata(&file).is_ok_and(|f| f.len() > 1_000_000)
    });
    // More than the queues on the way hold, and nothing comes behind it.
    signal(recorder.0.id(), "STOP");
    for _ in 0..40 {
        put();
        sleep(Duration::from_millis(10));
    }
    sent += 40;
    signal(recorder.0.id(), "CONT");
    // The publisher tells the number of its last message twice a second.
    sleep(Duration::from_secs(2));
    let (code, message) = recorder.end("INT");
    assert_eq!(code, Some(3), "{message}");
    let kept = numbers(&bag).len();
    assert!(kept < sent, "{message}");
    assert!(message.contains(&format!("/data: {kept} messages, {} lost", sent - kept)), "{sent}: {message}");
    assert!(!message.contains("link"), "{message}");
}

#[test]
fn a_recorder_that_loses_its_publisher_says_so() {
    let bench = Bench::new();
    let (source, bag) = (bench.path("source"), bench.path("bag"));
    write_bag(&source, 40, 50, 100);
    let recorder = bench.record(&bag, &["/data"]);
    let remote = Remote::new(bench.domain.id);
    let (_data, sent) = remote.listen("/data", IMAGE, Qos::Images);
    let played = |how: &str| {
        let mut playing = bench.start(&["bag", "play", utf8(&source), "--loop"]);
        (0..20).for_each(|_| drop(sent.recv_timeout(Duration::from_secs(30)).expect("a message")));
        signal(playing.0.id(), how);
        playing.0.wait().expect("it ends");
    };
    // One that ends in order is no loss; for one that is killed nobody knows.
    played("INT");
    sleep(Duration::from_secs(2));
    assert_eq!(remote.transport.lost_publishers(), []);
    played("KILL");
    wait_until("the loss", || remote.transport.lost_publisher("/data").is_some());
    // The recorder looks by itself.
    sleep(Duration::from_secs(1));
    let (code, message) = recorder.end("INT");
    assert_eq!(code, Some(3), "{message}");
    assert_has(&message, &["/data: ", " 0 lost", "the link to /rosbag2_player was lost"]);
}

/// The numbers of the next `count` samples, after which no other follows within 300 ms.
fn arrived(samples: &Receiver<RawSample>, count: usize) -> Vec<u32> {
    let next = || samples.recv_timeout(Duration::from_secs(30)).expect("a sample");
    let mut came: Vec<_> = (0..count).map(|_| next()).collect();
    sleep(Duration::from_millis(300));
    came.extend(samples.try_iter());
    came.iter().map(|sample| number(&sample.payload)).collect()
}

#[test]
fn a_replay_is_driven_by_services_and_tells_the_time() {
    let bench = Bench::new();
    let remote = Remote::new(bench.domain.id);
    let source = bench.path("source");
    write_bag(&source, 20, 100, 100);
    let (_data, data) = remote.listen("/data", IMAGE, Qos::Images);
    let (_time, time) = remote.listen("/clock", "rosgraph_msgs/msg/Clock", Qos::Clock);
    let mut playing = bench.start(&["bag", "play", utf8(&source), "--start-paused", "--clock", "50"]);
    wait_until("the player", || remote.transport.is_ready("/rosbag2_player"));
    let paused: player::IsPausedResponse = call!(remote, "IsPaused", player::IsPausedRequest::default());
    assert!(paused.paused);
    let clock = |samples: &Receiver<RawSample>| -> Vec<u64> {
        let times =
            samples.try_iter().map(|s| cdr::from_slice::<rosgraph_msgs::Clock>(&s.payload).expect("a time"));
        times.map(|time| time.clock.as_ns()).collect()
    };
    // The clock is published while the player is paused.
    let mut still = Vec::new();
    wait_until("eleven messages on /clock", || {
        still.extend(clock(&time));
        still.len() > 10
    });
    assert!(still.iter().all(|t| *t == START), "{still:?}");
    assert!(data.try_recv().is_err(), "no message is sent while the player is paused");

    let next: player::PlayNextResponse = call!(remote, "PlayNext", player::PlayNextRequest::default());
    assert!(next.success);
    assert_eq!(arrived(&data, 1), [0]);
    let burst: player::BurstResponse = call!(remote, "Burst", player::BurstRequest { num_messages: 3 });
    assert_eq!(burst.actually_burst, 3);
    assert_eq!(arrived(&data, 3), [1, 2, 3]);
    assert_eq!(clock(&time).last(), Some(&(START + 300 * MS)), "a step takes the clock along");

    let rate: player::SetRateResponse = call!(remote, "SetRate", player::SetRateRequest { rate: 0.0 });
    assert!(!rate.success, "0 is no rate");
    let rate: player::SetRateResponse = call!(remote, "SetRate", player::SetRateRequest { rate: 2.0 });
    assert!(rate.success);
    let rate: player::GetRateResponse = call!(remote, "GetRate", player::GetRateRequest::default());
    assert_eq!(rate.rate, 2.0);
    let seek = |ns: u64| -> bool {
        let response: player::SeekResponse =
            call!(remote, "Seek", player::SeekRequest { time: Time::from_ns(START + ns) });
        response.success
    };
    assert!(!seek(5_000 * MS), "the bag lasts 1.9 s");
    assert!(seek(950 * MS));

    let began = Instant::now();
    let _: player::ResumeResponse = call!(remote, "Resume", player::ResumeRequest::default());
    let code = playing.0.wait().expect("it ends").code();
    assert_eq!(code, Some(0));
    // 0.95 s of the bag at twice the speed, and what the end of a session takes.
    assert!(began.elapsed() > Duration::from_millis(475), "{:?}", began.elapsed());
    assert_eq!(arrived(&data, 10), (10..20).collect::<Vec<_>>());
    let ran = clock(&time);
    assert!(ran.is_sorted() && ran.last().is_some_and(|t| *t > START + 1_800 * MS), "{ran:?}");
}

/// The further services and the parameters of ROS 2 Jazzy's player.
#[test]
fn a_replay_is_stopped_by_a_service_and_has_the_parameters_of_a_player() {
    let bench = Bench::new();
    let remote = Remote::new(bench.domain.id);
    let source = bench.path("source");
    write_bag(&source, 20, 100, 100);
    let mut playing = bench.start(&["bag", "play", utf8(&source), "--start-paused"]);
    wait_until("the player", || remote.transport.is_ready("/rosbag2_player"));
    let dump = bench.run(&["param", "dump", "/rosbag2_player"]);
    let expected = "/rosbag2_player:\n  ros__parameters:\n    qos_overrides:\n      /parameter_events:\n        publisher:\n\
                    \u{20}         depth: 1000\n          durability: volatile\n          history: keep_last\n\
                    \u{20}         reliability: reliable\n    start_type_description_service: true\n    use_sim_time: false\n";
    assert_eq!(text(&dump), expected);
    assert_has(&bench.says(1, "param set /rosbag2_player use_sim_time true"), &["is read-only"]);
    let play: player::PlayResponse = call!(remote, "Play", player::PlayRequest::default());
    assert!(!play.success, "a playback runs already");
    let _: player::StopResponse = call!(remote, "Stop", player::StopRequest::default());
    assert_eq!(playing.0.wait().expect("it ends").code(), Some(0));
}

#[test]
fn a_replay_is_toggled_cut_and_repeated() {
    let bench = Bench::new();
    let remote = Remote::new(bench.domain.id);
    let source = bench.path("source");
    write_bag(&source, 20, 100, 100);
    let (_data, data) = remote.listen("/renamed", IMAGE, Qos::Images);
    let (_time, time) = remote.listen("/clock", "rosgraph_msgs/msg/Clock", Qos::Clock);
    let arguments = ["bag", "play", utf8(&source), "--start-offset", "0.5", "--playback-duration", "0.25"];
    let arguments = [&arguments[..], &["--loop", "--rate", "0.5", "--remap", "/data:=/renamed"]].concat();
    let playing = bench.start(&arguments);
    let mut came = Vec::new();
    wait_until("two rounds", || {
        came.extend(data.try_iter().map(|s| number(&s.payload)));
        came.len() >= 7
    });
    assert_eq!(came[..7], [5, 6, 7, 5, 6, 7, 5]);
    let _: player::TogglePausedResponse =
        call!(remote, "TogglePaused", player::TogglePausedRequest::default());
    arrived(&data, 0);
    sleep(Duration::from_millis(700));
    assert!(data.try_recv().is_err(), "paused");
    let _: player::TogglePausedResponse =
        call!(remote, "TogglePaused", player::TogglePausedRequest::default());
    arrived(&data, 1);
    let next: player::PlayNextResponse = call!(remote, "PlayNext", player::PlayNextRequest::default());
    assert!(!next.success, "only while paused");
    assert_eq!(playing.interrupt(), Some(0));
    assert_eq!(time.try_iter().count(), 0, "no time without --clock");
}

#[test]
fn a_topic_of_two_types_is_replayed_with_both() {
    const CAMERA_INFO: &str = "sensor_msgs/msg/CameraInfo";
    let bench = Bench::new();
    let remote = Remote::new(bench.domain.id);
    let source = bench.path("source");
    std::fs::create_dir(&source).expect("a folder");
    for (number, type_name) in [IMAGE, CAMERA_INFO].into_iter().enumerate() {
        let part = bench.path(&format!("part_{number}"));
        let mut bag = BagWriter::create(&part, Compression::None).expect("a new bag");
        let topic = bag.topic(&BagTopic::new("/data", type_name, Qos::Images)).expect("a topic");
        bag.write(topic, START, START, &[0, 1, 0, 0, number as u8, 0, 0, 0]).expect("writable");
        bag.finish().expect("writable");
        let name = format!("part_{number}_0.mcap");
        std::fs::rename(part.join(&name), source.join(&name)).expect("moved");
    }
    let listeners = [IMAGE, CAMERA_INFO].map(|type_name| remote.listen("/data", type_name, Qos::Images));
    assert_has(&bench.says(0, "bag play @/source"), &["/data: 2 messages"]);
    assert_eq!(listeners.map(|(_guard, samples)| arrived(&samples, 1)), [[0], [1]]);
}

/// A misspelt topic is no quiet recording of nothing.
#[test]
fn a_topic_that_nobody_publishes_is_a_loss_of_the_recording() {
    let bench = Bench::new();
    let recorder = bench.record(&bench.path("typo"), &["/recoverd"]);
    assert_eq!(recorder.end("INT").0, Some(3));
}

/// The tokens of a node come and go in any order: a recorder asks for a compressed variant only where the image itself is not recorded.
#[test]
fn a_recorder_asks_for_files_only_where_there_is_no_image() {
    let bench = Bench::new();
    let peer = Peer::new(&bench);
    let early = peer.advertise("/early/compressed", MessageKind::CompressedImage);
    let alone = peer.advertise("/alone/compressed", MessageKind::CompressedImage);
    let bag = bench.path("bag");
    let recording = bench.record(&bag, &[]);
    sleep(Duration::from_millis(120));
    let image = peer.advertise("/early", MessageKind::Image);
    wait_until("the image and the file without an image", || image.wanted() && alone.wanted());
    drop(image);
    // Longer than the recorder waits for an image.
    sleep(Duration::from_millis(500));
    assert!(!early.wanted(), "the images were recorded");
    assert_eq!(recording.interrupt(), Some(0));
    let topics = BagReader::open(&bag).expect("a whole bag").topics();
    let names: Vec<&str> = topics.iter().map(|topic| topic.topic.name.as_str()).collect();
    assert!(names.contains(&"/alone/compressed") && !names.contains(&"/early/compressed"), "{names:?}");
}
