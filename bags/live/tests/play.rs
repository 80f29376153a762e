//! Replays: what was recorded with [`BagWriter`] is played by [`Player`], and what the services of a player ask for and
//! answer.

use std::path::{Path, PathBuf};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use modulo_bags::bag::{BagReader, BagWriter, Compression};
use modulo_bags_live::control::{PlayerAction, PlayerCommand, PlayerReply, Service};
use modulo_bags_live::play::{PlayOptions, Player};
use modulo_msgs::builtin_interfaces::Time;
use modulo_msgs::cdr;
use modulo_msgs::rosbag2_interfaces::{
    BurstRequest, BurstResponse, GetRateResponse, IsPausedResponse, PauseRequest, SeekRequest,
    SetRateRequest, SetRateResponse,
};
use tempfile::TempDir;

use modulo_bags::bag::BagTopic;
use modulo_runtime::Qos;

/// A folder that lasts as long as the guard, and the path of `name` in it.
fn temporary(name: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join(name);
    (folder, path)
}

/// Topic number `i`.
fn topic(i: usize) -> BagTopic {
    BagTopic::new(&format!("/topic_{i}"), "std_msgs/msg/String", Qos::Results)
}

/// A bag of ten messages, 100 ms apart, on two topics by turns.
fn recorded() -> (TempDir, PathBuf) {
    let (folder, path) = temporary("bag");
    let mut recorder = BagWriter::create(&path, Compression::Lz4).expect("new");
    recorder.topic(&topic(2)).expect("new");
    for i in 0..10 {
        recorder.record(&topic(i % 2), 5_000 + i as u64 * 100_000_000, 1, &[i as u8]).expect("written");
    }
    let counts = recorder.finish().expect("finished");
    assert_eq!(counts.iter().map(|c| c.messages).collect::<Vec<_>>(), [0, 5, 5]);
    (folder, path)
}

fn player(path: &Path, options: &PlayOptions) -> Player {
    Player::new(BagReader::open(path).expect("a bag"), options).expect("possible")
}

/// (due in ms, payload) of the next `n` messages.
fn next(player: &mut Player, n: usize) -> Vec<(u64, u8)> {
    let due = std::iter::from_fn(|| player.next_message()).take(n);
    due.map(|due| due.expect("readable")).map(|due| (due.0 / 1_000_000, due.1.data[0])).collect()
}

/// The same from the start.
fn played(path: &Path, options: &PlayOptions, n: usize) -> Vec<(u64, u8)> {
    next(&mut player(path, options), n)
}

#[test]
fn messages_are_due_at_their_time() {
    let (_folder, path) = recorded();
    let once = PlayOptions::default();
    assert_eq!(played(&path, &once, 99), (0..10).map(|i| (u64::from(i) * 100, i)).collect::<Vec<_>>());
    let late = PlayOptions { start_offset: Duration::from_millis(750), ..once.clone() };
    assert_eq!(played(&path, &late, 99), [(50, 8), (150, 9)]);
    let short = PlayOptions { duration: Some(Duration::from_millis(150)), ..late };
    assert_eq!(played(&path, &short, 99), [(50, 8), (150, 9)]);
    let shorter = PlayOptions { duration: Some(Duration::from_millis(149)), ..short };
    assert_eq!(played(&path, &shorter, 99), [(50, 8)]);
    let one = PlayOptions { topics: Some(vec![topic(1).name]), ..once };
    assert_eq!(played(&path, &one, 2), [(100, 1), (300, 3)]);
}

#[test]
fn a_loop_goes_on_where_the_round_ended() {
    let (_folder, path) = recorded();
    let start_offset = Duration::from_millis(800);
    let options = PlayOptions { repeats: true, start_offset, ..PlayOptions::default() };
    assert_eq!(played(&path, &options, 5), [(0, 8), (100, 9), (100, 8), (200, 9), (200, 8)]);
    let silent = PlayOptions { topics: Some(vec!["/topic_2".into()]), ..options };
    assert_eq!(played(&path, &silent, 5), []);
}

#[test]
fn a_round_may_be_short() {
    let (_folder, path) = recorded();
    let duration = Some(Duration::from_millis(150));
    let options = PlayOptions { repeats: true, duration, ..PlayOptions::default() };
    assert_eq!(played(&path, &options, 5), [(0, 0), (100, 1), (150, 0), (250, 1), (300, 0)]);
}

/// A name that is misspelt would play nothing, without a word.
#[test]
fn topics_that_are_not_in_the_bag_are_refused() {
    let (_folder, path) = recorded();
    let of = |names: &[&str]| {
        let topics = Some(names.iter().map(|name| (*name).to_owned()).collect());
        Player::new(BagReader::open(&path).expect("a bag"), &PlayOptions { topics, ..PlayOptions::default() })
    };
    let why = of(&["/none", "topic_1"]).err().expect("refused").to_string();
    assert_eq!(why, "the bag has none of the topics /none, topic_1; it has /topic_2, /topic_0, /topic_1");
    let player = of(&["/none", "/topic_1"]).expect("one is there");
    assert_eq!(player.topics().iter().map(|counted| &*counted.topic.name).collect::<Vec<_>>(), ["/topic_1"]);
}

/// Its messages would come without a pause.
#[test]
fn a_part_without_a_duration_is_played_only_once() {
    let (_folder, path) = recorded();
    let (_single, one) = temporary("one");
    let mut recorder = BagWriter::create(&one, Compression::None).expect("new");
    recorder.record(&topic(0), 5_000, 1, &[7]).expect("written");
    recorder.finish().expect("finished");
    let none = PlayOptions { duration: Some(Duration::ZERO), ..PlayOptions::default() };
    let end = PlayOptions { start_offset: Duration::from_millis(900), ..PlayOptions::default() };
    for (path, options) in [(&path, none), (&path, end), (&one, PlayOptions::default())] {
        assert_eq!(played(path, &options, 9).len(), 1, "{options:?}");
        let forever = PlayOptions { repeats: true, ..options };
        let refused = Player::new(BagReader::open(path).expect("a bag"), &forever).err();
        assert!(refused.is_some_and(|why| why.to_string().contains("lasts 0ns")), "{forever:?}");
    }
}

#[test]
fn a_seek_goes_on_from_there() {
    let (_folder, path) = recorded();
    let start = 5_000;
    let mut once = player(&path, &PlayOptions::default());
    assert_eq!(next(&mut once, 3), [(0, 0), (100, 1), (200, 2)]);
    assert_eq!(once.seek(start + 650_000_000), Some(650_000_000));
    assert_eq!(next(&mut once, 99), [(700, 7), (800, 8), (900, 9)]);
    assert_eq!(once.seek(start), Some(0));
    assert_eq!(next(&mut once, 1), [(0, 0)]);
    for outside in [start - 1, start + 900_000_001] {
        assert_eq!(once.seek(outside), None);
    }
    assert_eq!(next(&mut once, 1), [(100, 1)]);

    let mut forever = player(&path, &PlayOptions { repeats: true, ..PlayOptions::default() });
    forever.seek(start + 850_000_000).expect("within");
    assert_eq!(next(&mut forever, 3), [(900, 9), (900, 0), (1000, 1)]);
}

#[test]
fn the_time_of_the_bag_is_that_of_the_position() {
    let (_folder, path) = recorded();
    let times = |repeats| {
        let player = player(&path, &PlayOptions { repeats, ..PlayOptions::default() });
        [0, 1, 899_999_999, 900_000_000, 1_000_000_000].map(|position| player.log_time(position) - 5_000)
    };
    assert_eq!(times(false), [0, 1, 899_999_999, 900_000_000, 900_000_000]);
    assert_eq!(times(true), [0, 1, 899_999_999, 0, 100_000_000]);
}

#[test]
fn impossible_options_are_refused() {
    let (_folder, path) = recorded();
    let refused = |options: &PlayOptions| {
        Player::new(BagReader::open(&path).expect("a bag"), options).err().expect("refused")
    };
    let late = PlayOptions { start_offset: Duration::from_secs(2), ..Default::default() };
    let error = refused(&late).to_string();
    assert!(error.contains("2s") && error.contains("900ms"), "{error}");
}

fn action<T: serde::Serialize>(service: Service, request: &T) -> PlayerAction {
    service.action(&cdr::to_vec(request).expect("short")).expect("readable")
}

#[test]
fn requests_are_commands() {
    assert_eq!(action(Service::Pause, &PauseRequest::default()), PlayerAction::Pause(Some(true)));
    assert_eq!(action(Service::SetRate, &SetRateRequest { rate: 0.5 }), PlayerAction::SetRate(0.5));
    assert_eq!(action(Service::Burst, &BurstRequest { num_messages: 3 }), PlayerAction::Step(Some(3)));
    assert_eq!(action(Service::Burst, &BurstRequest { num_messages: 0 }), PlayerAction::Step(None));
    let time = Time { sec: 2, nanosec: 5 };
    assert_eq!(action(Service::Seek, &SeekRequest { time }), PlayerAction::Seek(2_000_000_005));
    assert!(Service::Seek.action(&[0, 1, 0, 0, 7]).is_err(), "a request that is cut");
    for service in Service::ALL {
        let (_, ros_type) = service.name_and_type();
        assert!(modulo_msgs::type_hash(ros_type).is_some(), "{ros_type}");
    }
}

#[test]
fn answers_are_responses() {
    let (queue, orders) = channel::<PlayerCommand>();
    let replay = thread::spawn(move || {
        for order in orders {
            let answer = PlayerReply { done: false, played: 4, is_paused: true, rate: 2.5 };
            order.answer.send(answer).expect("somebody waits");
        }
    });
    let burst = cdr::to_vec(&BurstRequest { num_messages: 9 }).expect("short");
    let rate = cdr::to_vec(&SetRateRequest { rate: -1.0 }).expect("short");
    let empty = cdr::to_vec(&PauseRequest::default()).expect("short");
    let call = |service: Service, request: &[u8]| {
        service.call(request, &|order| queue.send(order).is_ok()).expect("answered")
    };
    let burst: BurstResponse = cdr::from_slice(&call(Service::Burst, &burst)).expect("a response");
    assert_eq!(burst.actually_burst, 4);
    let set: SetRateResponse = cdr::from_slice(&call(Service::SetRate, &rate)).expect("a response");
    assert!(!set.success);
    let rate: GetRateResponse = cdr::from_slice(&call(Service::GetRate, &empty)).expect("a response");
    assert_eq!(rate.rate, 2.5);
    let paused: IsPausedResponse = cdr::from_slice(&call(Service::IsPaused, &empty)).expect("a response");
    assert!(paused.paused);
    drop(queue);
    replay.join().expect("ends");
    let (queue, orders) = channel();
    drop(orders);
    assert!(
        Service::Pause.call(&empty, &|order| queue.send(order).is_ok()).is_err(),
        "nobody replays any more"
    );
}
