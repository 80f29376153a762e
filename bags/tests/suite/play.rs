//! Recorded with [`Recorder`], replayed with [`Player`].

use std::path::Path;
use std::time::Duration;

use modulo_bags::bag::{BagReader, Compression};
use modulo_bags::play::{PlayError, PlayOptions, Player, Repeat};
use modulo_bags::record::Recorder;

use crate::writing::topic;

/// Ten messages, 100 ms apart, on two topics by turns.
fn record(path: &Path) {
    let mut recorder = Recorder::create(path, Compression::Lz4).expect("new");
    recorder.announce(&topic(2)).expect("new");
    for i in 0..10 {
        recorder.record(&topic(i % 2), 5_000 + i as u64 * 100_000_000, 1, &[i as u8]).expect("written");
    }
    let counts = recorder.finish().expect("finished");
    assert_eq!(counts.iter().map(|c| c.messages).collect::<Vec<_>>(), [0, 5, 5]);
}

/// (due in ms, payload) of the first `n` messages.
fn played(path: &Path, options: &PlayOptions, n: usize) -> Vec<(u128, u8)> {
    let mut player = Player::new(BagReader::open(path).expect("a bag"), options).expect("possible");
    let due = std::iter::from_fn(|| player.next_due()).take(n);
    due.map(|due| due.expect("readable")).map(|due| (due.after.as_millis(), due.message.data[0])).collect()
}

#[test]
fn messages_are_due_at_their_time() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("bag");
    record(&path);
    let once = PlayOptions::default();
    assert_eq!(played(&path, &once, 99), (0..10).map(|i| (u128::from(i) * 100, i)).collect::<Vec<_>>());
    let fast = PlayOptions { rate: 2.0, start_offset: Duration::from_millis(750), ..once.clone() };
    assert_eq!(played(&path, &fast, 99), [(25, 8), (75, 9)]);
    let one = PlayOptions { topics: Some(vec![topic(1).name]), ..once };
    assert_eq!(played(&path, &one, 2), [(100, 1), (300, 3)]);
}

#[test]
fn a_loop_goes_on_where_the_round_ended() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("bag");
    record(&path);
    let start_offset = Duration::from_millis(800);
    let options = PlayOptions { repeat: Repeat::Forever, start_offset, ..PlayOptions::default() };
    assert_eq!(played(&path, &options, 5), [(0, 8), (100, 9), (100, 8), (200, 9), (200, 8)]);
    let silent = PlayOptions { topics: Some(vec!["/none".into()]), ..options };
    assert_eq!(played(&path, &silent, 5), []);
}

#[test]
fn impossible_options_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("bag");
    record(&path);
    let refused = |options: &PlayOptions| {
        Player::new(BagReader::open(&path).expect("a bag"), options).err().expect("refused")
    };
    for rate in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(refused(&PlayOptions { rate, ..Default::default() }), PlayError::Rate { .. }));
    }
    let late = PlayOptions { start_offset: Duration::from_secs(2), ..Default::default() };
    let error = refused(&late).to_string();
    assert!(error.contains("2s") && error.contains("900ms"), "{error}");
}
