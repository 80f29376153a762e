//! [`Attachment`]: the 33 bytes that go with every sample of rmw_zenoh; [`Gaps`], which counts the samples that were lost
//! on the way by their sequence numbers; and [`Delays`], which notices slow links and clocks that differ by their times.

use std::collections::BTreeMap;

/// The attachment of a sample; readers drop samples without one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// Counts from 1 per publisher.
    pub sequence: i64,
    /// Source time, nanoseconds since the epoch.
    pub stamp_ns: i64,
    /// Global id of the publisher.
    pub gid: [u8; 16],
    /// The sequence numbers that the publisher uses for a message like this one, at least 1. It is not on the wire, but known from
    /// the graph: more than 1 where some readers are sent samples of their own.
    pub numbers: u32,
}

impl Attachment {
    /// Length on the wire.
    pub const LEN: usize = 33;

    /// Returns the bytes on the wire: two little-endian integers, the length 16, and the gid.
    pub fn to_bytes(&self) -> [u8; Self::LEN] {
        let mut bytes = [0; Self::LEN];
        bytes[..8].copy_from_slice(&self.sequence.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.stamp_ns.to_le_bytes());
        // rmw_zenoh writes the id as a sequence, whose length comes before its bytes.
        bytes[16] = 16;
        bytes[17..].copy_from_slice(&self.gid);
        bytes
    }

    /// Reads it; `None` when it is not 33 bytes of that shape.
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let (sequence, rest) = bytes.split_first_chunk::<8>()?;
        let (stamp, rest) = rest.split_first_chunk::<8>()?;
        let (&length, gid) = rest.split_first()?;
        Some(Self {
            sequence: i64::from_le_bytes(*sequence),
            stamp_ns: i64::from_le_bytes(*stamp),
            gid: (length == 16).then_some(gid)?.try_into().ok()?,
            numbers: 1,
        })
    }
}

/// Publishers of one topic that are remembered; more only come from restarts.
const PUBLISHERS: usize = 1024;
/// Samples that cannot be missing at once: those of 14 hours at 20 Hz.
const JUMP: u64 = 1 << 20;

/// Counts the holes in the sequence numbers of each publisher.
#[derive(Debug, Default)]
pub struct Gaps(BTreeMap<[u8; 16], Heard>);

/// What has come of the messages of one publisher. Where each message has one number, `last - first + 1 = received + missing`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heard {
    /// Number of the first message, or of the first one after a jump.
    pub first: i64,
    /// The greatest number so far.
    pub last: i64,
    /// Number of messages that came since the first one.
    pub received: u64,
    /// Number of messages that did not come.
    pub missing: u64,
    /// The numbers that the last message has used.
    numbers: i64,
}

/// What the number of a sample says of those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// So many are missing.
    Missing(u64),
    /// The numbers have jumped, and the count starts anew: whether any is missing is not known.
    Jumped,
}

impl Gaps {
    /// Returns how many samples are missing before this one. The first sample of a publisher starts its
    /// count: earlier ones were not for this reader. A number below the greatest one is a sample that came late or
    /// twice, and counts as no gap. A publisher that restarts has another gid.
    pub fn step(&mut self, attachment: &Attachment) -> Step {
        let Attachment { gid, sequence, numbers, .. } = *attachment;
        if self.0.len() >= PUBLISHERS && !self.0.contains_key(&gid) {
            // Any entry may go: a publisher that still sends starts its count anew.
            self.0.pop_first();
        }
        let used = i64::from(numbers.max(1));
        let anew = Heard { first: sequence, last: sequence, received: 0, missing: 0, numbers: used };
        let heard = self.0.entry(gid).or_insert(anew);
        // The numbers come from the wire and may be anything. A reader that comes is known here a little earlier or later than
        // the publisher begins to count it.
        let step = sequence.saturating_sub(heard.last) / heard.numbers.max(used);
        if step.unsigned_abs() > JUMP {
            *heard = Heard { received: 1, ..anew };
            return Step::Jumped;
        }
        let missing = u64::try_from(step.saturating_sub(1)).unwrap_or(0);
        heard.received += 1;
        heard.missing += missing;
        (heard.last, heard.numbers) = (sequence, used).max((heard.last, heard.numbers));
        Step::Missing(missing)
    }

    /// Counts what is missing at the end, where `sent` knows the number of the last message of a publisher. Returns how many.
    pub fn end(&mut self, sent: impl Fn(&[u8; 16]) -> Option<i64>) -> u64 {
        let mut all = 0;
        // Where some readers are sent samples of their own, numbers are no messages.
        for (publisher, heard) in self.0.iter_mut().filter(|(_, heard)| heard.numbers == 1) {
            let last = sent(publisher).unwrap_or(heard.last);
            let missing = u64::try_from(last.saturating_sub(heard.last)).unwrap_or(0);
            if missing <= JUMP {
                heard.missing += missing;
                heard.last = heard.last.max(last);
                all += missing;
            }
        }
        all
    }

    /// Returns what has come of each publisher, by its global id.
    pub fn heard(&self) -> impl Iterator<Item = (&[u8; 16], &Heard)> {
        self.0.iter()
    }
}

/// Time over which the least delay of a topic is looked for, ns. Within it, some message finds the link and the machine idle.
const DELAY_WINDOW_NS: u64 = 2_000_000_000;
/// Fewest messages in a window that say anything.
const DELAY_SAMPLES: u32 = 5;
/// A least delay above this is reported, ns: no network in a vehicle needs as much.
const SLOW_NS: i64 = 500_000_000;
/// A least delay below this is reported as well, ns: the clocks differ. NTP keeps the clocks of a network within a few milliseconds.
const EARLY_NS: i64 = -100_000_000;

/// The delays between the sending and the arrival of messages, by topic, each by the clock of its machine.
#[derive(Debug, Default)]
pub struct Delays {
    topics: BTreeMap<String, DelayWindow>,
}

#[derive(Debug, Default)]
struct DelayWindow {
    start_ns: u64,
    samples: u32,
    least_ns: i64,
    reported: bool,
}

impl Delays {
    /// Notes a message of `topic` that was sent and has arrived at these times, ns since the epoch. Returns a warning when
    /// all messages of two seconds were late or early, once until they are in time again.
    pub fn note(&mut self, topic: &str, sent_ns: i64, arrived_ns: u64) -> Option<String> {
        let delay_ns = i64::try_from(arrived_ns).unwrap_or(i64::MAX).saturating_sub(sent_ns);
        if !self.topics.contains_key(topic) {
            self.topics.insert(topic.to_owned(), DelayWindow { start_ns: arrived_ns, ..Default::default() });
        }
        let window = self.topics.get_mut(topic)?;
        window.least_ns = if window.samples == 0 { delay_ns } else { window.least_ns.min(delay_ns) };
        window.samples += 1;
        // A clock that was set back also ends the window.
        let over = arrived_ns.abs_diff(window.start_ns) >= DELAY_WINDOW_NS && window.samples >= DELAY_SAMPLES;
        if !over {
            return None;
        }
        let (least_ns, was_reported) = (window.least_ns, window.reported);
        let reported = !(EARLY_NS..=SLOW_NS).contains(&least_ns);
        *window = DelayWindow { start_ns: arrived_ns, reported, ..Default::default() };
        (reported && !was_reported).then(|| delay_warning(least_ns))
    }
}

fn delay_warning(least_ns: i64) -> String {
    let seconds = least_ns.unsigned_abs() as f64 / 1e9;
    if least_ns < 0 {
        return format!(
            "messages arrive {seconds:.2} s before they were sent: the clocks of the two machines differ by at least \
             this time; synchronise them with NTP or PTP"
        );
    }
    format!(
        "messages arrive at least {seconds:.2} s after they were sent: the link is slow, or the clocks of the two machines \
         differ; reduce the data on the link, or synchronise the clocks with NTP or PTP"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Sent by a real ROS 2 Jazzy node under rmw_zenoh_cpp 0.2.10.
    #[test]
    fn equals_those_of_a_real_node() {
        let golden = "1b000000000000009b044c0adbd3e9181001d577b5cefae79ff06ef90b046c84b7";
        let bytes: Vec<u8> = (0..golden.len() / 2)
            .map(|i| u8::from_str_radix(&golden[2 * i..2 * i + 2], 16).expect("hex"))
            .collect();
        let attachment = Attachment::parse(&bytes).expect("a real attachment parses");
        assert_eq!(attachment.sequence, 27);
        assert_eq!(attachment.to_bytes().as_slice(), bytes);
    }

    proptest! {
        #[test]
        fn no_bytes_panic(bytes: Vec<u8>) {
            if let Some(attachment) = Attachment::parse(&bytes) {
                prop_assert_eq!(attachment.to_bytes().to_vec(), bytes);
            }
        }
    }

    #[test]
    fn counts_holes_of_each_publisher_from_its_first_sample_on() {
        let mut gaps = Gaps::default();
        let mut step = |publisher, sequence| {
            gaps.step(&Attachment { sequence, stamp_ns: 0, gid: [publisher; 16], numbers: 1 })
        };
        assert_eq!(
            [step(1, 40), step(1, 41), step(1, 44), step(2, 7), step(1, 45), step(2, 9)],
            [0, 0, 2, 0, 0, 1].map(Step::Missing)
        );
        // A late sample, and the one after the greatest.
        assert_eq!([step(1, 3), step(1, 46)], [0, 0].map(Step::Missing));
    }

    /// A peer, or a driver that starts its count at random, had made 9,223,372,036,854,775,805 lost messages of two.
    #[test]
    fn numbers_that_jump_start_the_count_anew() {
        let mut gaps = Gaps::default();
        let mut step = |sequence| gaps.step(&Attachment { sequence, stamp_ns: 0, gid: [1; 16], numbers: 1 });
        let jump = i64::try_from(JUMP).expect("small");
        assert_eq!([step(1), step(1 + jump)], [Step::Missing(0), Step::Missing(JUMP - 1)]);
        for far in [2 + 2 * jump, i64::MAX, 5, i64::MIN, 0] {
            assert_eq!([step(far), step(far.saturating_add(3))][0], Step::Jumped, "{far}");
        }
        assert_eq!([step(4), step(3 + jump)], [Step::Missing(0), Step::Missing(JUMP - 2)]);
    }

    proptest! {
        /// Whatever arrives, each number from the first one to the last that was sent is received or missing.
        #[test]
        fn every_number_is_received_or_missing(arrives in prop::collection::vec(prop::bool::ANY, 1..60)) {
            let mut gaps = Gaps::default();
            let mut missing = 0;
            for (sequence, _) in (1..).zip(&arrives).filter(|(_, arrives)| **arrives) {
                let step = gaps.step(&Attachment { sequence, stamp_ns: 0, gid: [1; 16], numbers: 1 });
                missing += if let Step::Missing(missing) = step { missing } else { 0 };
            }
            missing += gaps.end(|_| i64::try_from(arrives.len()).ok());
            prop_assert_eq!(gaps.end(|_| i64::try_from(arrives.len()).ok()), 0, "it is counted once");
            let received = arrives.iter().filter(|arrives| **arrives).count() as u64;
            if let Some((_, heard)) = gaps.heard().next() {
                prop_assert_eq!((heard.received, heard.missing), (received, missing));
                prop_assert_eq!(heard.first - 1 + (received + missing) as i64, arrives.len() as i64);
            }
        }
    }

    /// A publisher of Lyrical uses one number more for each message from the moment on at which a reader with a buffer of its
    /// own comes.
    #[test]
    fn numbers_of_other_readers_are_no_losses() {
        let mut gaps = Gaps::default();
        let mut step =
            |sequence, numbers| gaps.step(&Attachment { sequence, stamp_ns: 0, gid: [1; 16], numbers });
        assert_eq!(
            [(1, 1), (2, 1), (4, 2), (6, 2), (8, 2), (12, 2)].map(|(n, numbers)| step(n, numbers)),
            [0, 0, 0, 0, 0, 1].map(Step::Missing)
        );
        // The reader is known here two messages late, and later all readers are served on the base key.
        assert_eq!(
            [(15, 3), (18, 3), (19, 1), (20, 1), (22, 1)].map(|(n, numbers)| step(n, numbers)),
            [0, 0, 0, 0, 1].map(Step::Missing)
        );
    }

    #[test]
    fn late_and_early_messages_are_reported_once_until_they_are_in_time() {
        const S: i64 = 1_000_000_000;
        let mut delays = Delays::default();
        let mut now = 100 * S;
        // Thirty messages in three seconds with these delays; one message of ten was delayed by the link.
        let mut messages = |delay: i64| {
            let warnings = (0..30).filter_map(|number| {
                now += S / 10;
                let held = if number % 10 == 0 { S } else { 0 };
                delays.note("/modulo", now - delay - held, now as u64)
            });
            warnings.collect::<Vec<_>>()
        };
        assert_eq!(messages(S / 100), [""; 0]);
        let early = messages(-S);
        assert!(early.len() == 1 && early[0].contains("arrive 1.00 s before they were sent"), "{early:?}");
        assert_eq!(messages(-S), [""; 0], "it is reported already");
        assert_eq!(messages(S / 100), [""; 0]);
        let late = messages(S);
        assert!(late.len() == 1 && late[0].contains("at least 1.00 s after they were sent"), "{late:?}");
        assert_eq!(delays.note("/modulo", i64::MIN, u64::MAX), None, "any time may come from the wire");
    }

    #[test]
    fn remembers_a_bounded_number_of_publishers() {
        let mut gaps = Gaps::default();
        for publisher in 0..2 * PUBLISHERS as u128 {
            let gid = publisher.to_be_bytes();
            assert_eq!(
                gaps.step(&Attachment { sequence: 9, stamp_ns: 0, gid, numbers: 1 }),
                Step::Missing(0)
            );
        }
        assert_eq!(gaps.0.len(), PUBLISHERS);
    }
}
