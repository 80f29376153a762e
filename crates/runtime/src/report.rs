//! [`NodeReport`]: the counts and durations of a node. The launcher adds the reports of all nodes up.
//!
//! Durations are kept as mergeable histograms: percentiles over several processes are computed from counts.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use crate::message::Message;
use crate::wire::attachment::Heard;

/// Buckets of one stage: upper bound in microseconds to count.
pub type Histogram = BTreeMap<u64, u64>;

/// Quantiles of durations in ms, by the nearest rank.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 95th percentile.
    pub p95: f64,
    /// 99th percentile.
    pub p99: f64,
}

impl Percentiles {
    /// Returns the three quantiles that `at` gives; `None` without a duration.
    pub fn of(at: impl Fn(f64) -> Option<f64>) -> Option<Self> {
        Some(Self { p50: at(0.50)?, p95: at(0.95)?, p99: at(0.99)? })
    }
}

/// The messages that one node received, sent and lost, its detections, and the durations of its stages.
///
/// Every message that reached a node was taken by a step, replaced or left unread: `received = taken + replaced +
/// unread` for each topic. A message that could not be read was taken.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct NodeReport {
    /// Fully qualified name, such as `/unwrap`.
    pub node: String,
    /// Whether the node was still running when this was written. A node that crashed leaves such a report.
    pub running: bool,
    /// Whether the node has changed its inputs while it ran.
    pub swapped: bool,
    /// Messages that reached the node, by topic. While the node runs, those that wait for it are left out.
    pub received: BTreeMap<String, u64>,
    /// Messages that the node sent, by topic.
    pub published: BTreeMap<String, u64>,
    /// Messages that the node did not make because the topic had no reader, by topic.
    pub unwanted: BTreeMap<String, u64>,
    /// Messages that a newer one replaced before the node took them, by topic.
    pub replaced: BTreeMap<String, u64>,
    /// Messages that were lost on their way to the node, by topic.
    pub lost: BTreeMap<String, u64>,
    /// Messages that still waited when the node left the topic, by topic.
    pub unread: BTreeMap<String, u64>,
    /// Messages that could not be read, processed or sent, by topic.
    pub bad: BTreeMap<String, u64>,
    /// Messages that left each publisher of the node, by topic and global id.
    pub sent: BTreeMap<String, BTreeMap<String, u64>>,
    /// What each subscription has heard of each publisher, by topic; none within one process.
    pub heard: BTreeMap<String, Vec<Reading>>,
    /// Topics that the node reads as best effort: the sender does not promise that all messages arrive.
    pub best_effort: BTreeSet<String>,
    /// Topics that the node reads whose last message every late reader gets: only the last one matters.
    pub latched: BTreeSet<String>,
    /// Detections sent, by the stream that they were found in and by class.
    pub classes: BTreeMap<String, BTreeMap<String, u64>>,
    /// Status of the node, such as `engine` = `rten`.
    pub status: BTreeMap<String, String>,
    /// Durations by stage; buckets are (upper bound in microseconds, count).
    pub stages: BTreeMap<String, Histogram>,
}

/// What one subscription has heard of one publisher: `last - first + 1 = received + missing`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reading {
    /// Global id of the publisher.
    pub publisher: String,
    /// Number of the first message that came.
    pub first: i64,
    /// Number of the last message that came or is missing.
    pub last: i64,
    /// Messages that came.
    pub received: u64,
    /// Messages that did not come.
    pub missing: u64,
    /// The number of the subscription; one that heard another publisher before was there when this one came.
    pub subscription: u64,
    /// Whether the subscription lasted until the end of the node, and not until another input was chosen.
    pub lasted: bool,
}

/// Most readings of a topic in a report: a peer may declare publishers without end.
const READINGS: usize = 64;

/// Returns a global id as it is written in a report.
pub fn hex(publisher: &[u8; 16]) -> String {
    format!("{:032x}", u128::from_be_bytes(*publisher))
}

impl NodeReport {
    /// Creates an empty report of `node`.
    pub fn new(node: impl Into<String>) -> Self {
        Self { node: node.into(), ..Self::default() }
    }

    /// Books one duration of `stage`.
    pub fn book_stage(&mut self, stage: &str, nanoseconds: u64) {
        let bucket = bucket_of(nanoseconds / 1000);
        *self.stages.entry(stage.to_owned()).or_default().entry(bucket).or_default() += 1;
    }

    /// Books what a subscription of `topic` has heard of its publishers; `subscription` is its number, and whether it lasts.
    pub fn book_heard(
        &mut self,
        topic: &str,
        (subscription, lasted): (u64, bool),
        heard: &[([u8; 16], Heard)],
    ) {
        if heard.is_empty() {
            return;
        }
        let readings = self.heard.entry(topic.to_owned()).or_default();
        readings.extend(heard.iter().map(|(publisher, heard)| {
            let &Heard { first, last, received, missing, .. } = heard;
            Reading { publisher: hex(publisher), first, last, received, missing, subscription, lasted }
        }));
        readings.sort_by_key(|reading| Reverse(reading.received));
        readings.truncate(READINGS);
    }

    /// Counts one sent message, and its detections under the `stream` that the step has read; a source reads no stream.
    pub fn book_published(&mut self, topic: &str, message: &Message, stream: Option<&str>) {
        add(&mut self.published, topic, 1);
        if let (Message::Detections(array), Some(stream)) = (message, stream) {
            let classes = self.classes.entry(stream.to_owned()).or_default();
            for detection in &array.detections {
                let class = detection.results.first().map_or("", |r| r.hypothesis.class_id.as_str());
                add(classes, class, 1);
            }
        }
    }

    /// Returns the messages that reached no step although they were sent, by topic: replaced, lost or unread.
    pub fn dropped(&self) -> BTreeMap<String, u64> {
        let mut dropped = self.replaced.clone();
        // The causes are kept apart in the report and added only for the summary.
        for (topic, n) in self.lost.iter().chain(&self.unread) {
            add(&mut dropped, topic, *n);
        }
        dropped
    }
}

/// Adds `n` to the count of `key`.
pub fn add(counts: &mut BTreeMap<String, u64>, key: &str, n: u64) {
    // `entry` would allocate the key at each call.
    match counts.get_mut(key) {
        Some(count) => *count += n,
        None => {
            counts.insert(key.to_owned(), n);
        }
    }
}

/// Returns the upper bound, in microseconds, of the bucket that holds `us`: exact below 128, then at most 1.6 % wide.
pub fn bucket_of(us: u64) -> u64 {
    // Seven leading bits are kept, so above 127 a bucket is at most 1/64 of its value wide.
    let shift = (64 - us.leading_zeros()).saturating_sub(7);
    (((us >> shift) + 1) << shift) - 1
}

/// Returns the smallest bucket bound, in µs, at or below which the fraction `q` of all counts lies; `None` without any.
pub fn quantile(histogram: &Histogram, q: f64) -> Option<u64> {
    let total: u64 = histogram.values().sum();
    // Rank 0, which q = 0 gives, means the smallest value as well.
    let rank = ((total as f64 * q).ceil() as u64).clamp(1, total.max(1));
    let mut seen = 0;
    histogram.iter().find_map(|(&bound, &count)| {
        seen += count;
        (seen >= rank).then_some(bound)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_bucket_holds_its_value_within_two_percent(us in 0u64..1 << 40) {
            let bound = bucket_of(us);
            prop_assert!(bound >= us);
            prop_assert!(bound - us <= us / 50);
            prop_assert_eq!(bucket_of(bound), bound);
        }

        #[test]
        fn quantiles_agree_with_sorting(mut us in prop::collection::vec(0u64..127, 1..200), q in 0.0f64..=1.0) {
            let mut histogram = Histogram::new();
            for &v in &us {
                *histogram.entry(bucket_of(v)).or_default() += 1;
            }
            us.sort_unstable();
            let rank = ((us.len() as f64 * q).ceil() as usize).max(1);
            prop_assert_eq!(quantile(&histogram, q), Some(us[rank - 1]));
        }
    }

    #[test]
    fn nothing_counted_has_no_quantile() {
        assert_eq!(quantile(&Histogram::new(), 0.5), None);
    }

    #[test]
    fn a_report_survives_json() {
        let mut report = NodeReport::new("/unwrap");
        report.book_stage("unwrap", 5_300_000);
        report.book_stage("unwrap", 5_301_000);
        add(&mut report.replaced, "/modulo", 3);
        add(&mut report.lost, "/modulo", 4);
        add(&mut report.unread, "/ideal", 1);
        let text = serde_json::to_string(&report).expect("serialises");
        assert_eq!(serde_json::from_str::<NodeReport>(&text).expect("reads back"), report);
        assert_eq!(report.dropped(), [("/ideal".into(), 1), ("/modulo".into(), 7)].into());
    }
}
