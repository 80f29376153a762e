//! Swaps of inputs: no frame is lost and none is answered twice.

use proptest::prelude::*;

use super::super::LiveEvent;
use super::*;
use crate::transport::queue::{Keep, Limit, Queue};
use modulo_runtime::{ManualClock, MessageKind, ParameterError, Qos};

const S: u64 = 1_000_000_000;

struct Bench {
    queue: Arc<EventQueue>,
    slot: Slot,
}

fn address(topic: &str) -> Address {
    Address { topic: topic.into(), kind: MessageKind::Image, qos: Qos::Images, profile: None }
}

fn open(queue: &Arc<EventQueue>, topic: &str) -> SlotInput {
    let declared = Topic::new(topic, MessageKind::Image);
    SlotInput {
        topic: declared,
        address: address(topic),
        lane: queue.open(Keep::Latest),
        queue: queue.clone(),
        subscription: None,
    }
}

impl Bench {
    /// A node that reads `/a`.
    fn new() -> Self {
        let queue = Arc::new(Queue::new(Arc::new(ManualClock::at(0)), Limit { messages: 1, bytes: 1 }));
        let slot = Slot::new(open(&queue, "/a"));
        Self { queue, slot }
    }

    /// Returns the topics that are closed.
    fn change(&mut self, topic: &str) -> Vec<String> {
        let opened = (!self.slot.reads(&address(topic))).then(|| open(&self.queue, topic));
        let closed = self.slot.change(Topic::new(topic, MessageKind::Image), &address(topic), opened, 0);
        closed.into_iter().map(|input| input.address.topic.clone()).collect()
    }

    /// Returns whether the frame of `stamp` is answered, and the topic that is closed.
    fn frame(&mut self, topic: &str, stamp: u64) -> (bool, Option<String>) {
        let lane = self.slot.inputs().find(|input| input.address.topic == topic).expect("open").lane;
        let (answered, closed) = self.slot.admit(lane, stamp, 0);
        (answered, closed.map(|input| input.address.topic.clone()))
    }
}

const ANSWERED: (bool, Option<String>) = (true, None);
const REPLACED: (bool, Option<String>) = (false, None);

#[test]
fn a_stream_behind_the_old_one_begins_with_its_first_new_frame() {
    let mut bench = Bench::new();
    assert_eq!([4, 5].map(|stamp| bench.frame("/a", stamp)), [ANSWERED; 2]);
    assert_eq!(bench.change("/b"), [""; 0]);
    assert_eq!(bench.frame("/a", 6), ANSWERED, "the new stream has not begun");
    assert_eq!(bench.slot.in_use().name, "/a");
    assert_eq!([5, 6].map(|stamp| bench.frame("/b", stamp)), [REPLACED; 2], "answered from the old stream");
    assert_eq!(bench.frame("/a", 7), (false, Some("/a".into())), "the new stream shows it as well");
    assert_eq!([7, 8].map(|stamp| bench.frame("/b", stamp)), [ANSWERED; 2]);
    assert_eq!(bench.slot.in_use().name, "/b");
    assert_eq!(
        [8, 3].map(|stamp| bench.frame("/b", stamp)),
        [ANSWERED; 2],
        "without a swap, all are answered"
    );
}

#[test]
fn frames_on_their_way_on_the_old_stream_are_counted() {
    let mut bench = Bench::new();
    assert_eq!(bench.frame("/a", 4), ANSWERED);
    bench.change("/b");
    assert_eq!(bench.frame("/b", 7), ANSWERED);
    assert_eq!([5, 6].map(|stamp| bench.frame("/a", stamp)), [REPLACED; 2]);
    assert_eq!(bench.frame("/a", 7), (false, Some("/a".into())));
    assert_eq!(bench.slot.inputs().count(), 1);
}

#[test]
fn a_swap_back_takes_the_subscription_that_is_still_open() {
    let mut bench = Bench::new();
    assert_eq!(bench.frame("/a", 4), ANSWERED);
    bench.change("/b");
    assert_eq!(bench.change("/a"), ["/b"], "it has not begun");
    assert_eq!([5, 6].map(|stamp| bench.frame("/a", stamp)), [ANSWERED; 2]);
    bench.change("/b");
    assert_eq!(bench.frame("/b", 7), ANSWERED);
    assert_eq!(bench.change("/a"), [""; 0]);
    assert_eq!([bench.frame("/a", 7), bench.frame("/a", 8)], [REPLACED, ANSWERED]);
    assert_eq!(bench.frame("/b", 8), (false, Some("/b".into())));
    assert_eq!(bench.change("/c"), [""; 0]);
    assert_eq!(bench.change("/d"), ["/c"], "it has not begun, so that /a goes on");
    assert_eq!((bench.frame("/a", 9), bench.slot.in_use().name.as_str()), (ANSWERED, "/a"));
}

#[test]
fn a_source_that_starts_again_and_frames_without_a_stamp_are_answered() {
    let mut bench = Bench::new();
    assert_eq!([4, 5, 6].map(|stamp| bench.frame("/a", stamp)), [ANSWERED; 3]);
    bench.change("/b");
    assert_eq!(
        [bench.frame("/b", 5), bench.frame("/b", 4), bench.frame("/b", 5)],
        [REPLACED, ANSWERED, ANSWERED]
    );
    let mut bench = Bench::new();
    assert_eq!([1, 11 * S, 20 * S].map(|stamp| bench.frame("/a", stamp)), [ANSWERED; 3]);
    bench.change("/b");
    assert_eq!([10 * S, 9 * S].map(|stamp| bench.frame("/b", stamp)), [REPLACED, ANSWERED], "a recording");
    let mut bench = Bench::new();
    assert_eq!(bench.frame("/a", 0), ANSWERED);
    bench.change("/b");
    assert_eq!([0, 0].map(|stamp| bench.frame("/b", stamp)), [ANSWERED; 2]);
}

#[test]
fn a_stream_that_gives_no_frame_is_warned_of_once() {
    let mut bench = Bench::new();
    bench.change("/b");
    let mut warned = |now| bench.slot.look(now).0;
    let warning = |s| format!("no frame has come on /b for {s} s; the node still answers the frames of /a");
    assert_eq!([warned(2 * S - 1), warned(2 * S), warned(3 * S - 1)], [None, Some(warning(2)), None]);
    assert_eq!([warned(3 * S), warned(50 * S)], [None, None]);
    assert_eq!(bench.frame("/a", 1), ANSWERED);
    assert_eq!(bench.frame("/b", 2), ANSWERED);
    assert!(bench.slot.look(2 * S).1.is_none(), "the old stream may still reach the new one");
    let (warning, closed) = bench.slot.look(2 * S + 1);
    assert_eq!((warning, closed.map(|input| input.address.topic.clone())), (None, Some("/a".into())));
}

proptest! {
    /// Three streams of the same frames, each with a delay of its own, and swaps at any time: no frame is answered
    /// twice, their order stays, and from the first answered frame on each one is answered or seen as replaced.
    #[test]
    fn no_frame_is_answered_twice_or_missing(
        delays in [0u64..4, 0u64..4, 0u64..4],
        swaps in prop::collection::vec((8u64..64, 0usize..3), 0..12),
    ) {
        let names = ["/a", "/b", "/c"];
        let mut bench = Bench::new();
        let (mut answered, mut seen) = (Vec::new(), std::collections::BTreeSet::new());
        for time in 4u64..64 {
            for (_, to) in swaps.iter().filter(|(at, _)| *at == time) {
                if bench.slot.current().address.topic != names[*to] {
                    bench.change(names[*to]);
                }
            }
            for (name, delay) in names.iter().zip(&delays) {
                let stamp = time - delay;
                if bench.slot.inputs().any(|input| input.address.topic == *name) {
                    seen.insert(stamp);
                    if bench.frame(name, stamp).0 {
                        answered.push(stamp);
                    }
                }
            }
        }
        prop_assert!(answered.is_sorted_by(|a, b| a < b), "{answered:?}");
        let first = *answered.first().expect("a stream is always read");
        prop_assert!((first..60).all(|stamp| seen.contains(&stamp)), "{seen:?}");
    }
}

/// One that was opened for a change of parameters which was refused.
#[test]
fn an_input_that_is_dropped_closes_its_lane() {
    let bench = Bench::new();
    let opened = open(&bench.queue, "/b");
    let lane = opened.lane;
    bench.queue.push(lane, LiveEvent::Made(Err(ParameterError::new("model", "a.onnx", "is not there"))));
    assert_eq!(bench.queue.counts(lane).received, 1);
    drop(opened);
    assert_eq!(bench.queue.counts(lane).received, 0, "a lane that is closed has no counts");
}
