//! [`LostInCrash`]: messages that were not answered because a node crashed.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde::Serialize;

use super::NodeReport;

/// Messages of one topic that a crash kept from one reader.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LostInCrash {
    /// The topic.
    pub topic: String,
    /// The node that reads it.
    pub node: String,
    /// How many were lost; `None` when the accounts cannot tell.
    pub lost: Option<u64>,
    /// How many there were; `None` when the accounts cannot tell.
    pub sent: Option<u64>,
}

impl fmt::Display for LostInCrash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { topic, node, .. } = self;
        match (self.lost, self.sent) {
            (Some(lost), Some(sent)) => {
                write!(f, "lost in a crash: {lost} of {sent} frames of {topic} at {node}")
            }
            _ => write!(f, "lost in a crash: an unknown number of frames of {topic} at {node}"),
        }
    }
}

pub(super) struct Lives<'a>(Vec<&'a NodeReport>);

impl<'a> Lives<'a> {
    pub fn of_nodes(reports: &'a [NodeReport]) -> BTreeMap<&'a str, Self> {
        let mut nodes: BTreeMap<&str, Self> = BTreeMap::new();
        for report in reports {
            nodes.entry(&report.node).or_insert_with(|| Self(Vec::new())).0.push(report);
        }
        nodes
    }

    pub fn crashed(&self) -> bool {
        self.0.iter().any(|life| life.running)
    }

    pub fn sum(&self, counts: fn(&'a NodeReport) -> &'a BTreeMap<String, u64>, topic: &str) -> u64 {
        self.0.iter().filter_map(|life| counts(life).get(topic)).sum()
    }

    /// Returns the topics that the node reads, without those whose last message every late reader gets.
    pub fn reads(&self) -> BTreeSet<&'a str> {
        let topics =
            self.0.iter().flat_map(|life| life.received.keys().filter(|t| !life.latched.contains(*t)));
        topics.map(String::as_str).collect()
    }

    pub fn writes(&self, topic: &str) -> bool {
        self.0.iter().any(|life| life.published.contains_key(topic) || life.unwanted.contains_key(topic))
    }

    /// Whether all lives of the node read the same topics. A life that crashed before it subscribed reads none.
    fn reads_always_the_same(&self) -> bool {
        let mut inputs = self.0.iter().map(|life| &life.received).filter(|received| !received.is_empty());
        let first = inputs.next();
        !self.0.iter().any(|life| life.swapped)
            && inputs.all(|other| first.is_some_and(|f| f.keys().eq(other.keys())))
    }
}

/// Computes the messages that crashes took from each reader of each topic.
///
/// A reader has to account for every message that its senders counted, and for every message that they did not make
/// because the topic had no reader just then: those are the frames of the time in which it was down. What it has
/// neither taken nor replaced nor left unread, and what was not lost on the way either, is missing:
///
/// `missing = sent + unwanted - received - lost`, each over all lives, where `received = taken + replaced + unread`.
///
/// A latched topic is left out, since a reader that comes back gets its last message. The equation holds for a node that
/// reads a topic for the whole launch. Without a number is the loss of a reader whose inputs were changed at run time,
/// and of messages whose sender is no node of the launch.
pub(super) fn losses(reports: &[NodeReport]) -> Vec<LostInCrash> {
    of_readings(reports, |node, reader, topic, senders| {
        // Without a crash nothing can be missing: counts differ when a reader joins or leaves by itself.
        if !reader.crashed() && !senders.iter().any(|sender| sender.crashed()) {
            return None;
        }
        let (lost, sent) = if senders.is_empty() || !reader.reads_always_the_same() {
            (None, None)
        } else {
            let made =
                |node: &&Lives<'_>| node.sum(|r| &r.published, topic) + node.sum(|r| &r.unwanted, topic);
            // A message that was not made because the reader was down is lost for it as well.
            let made: u64 = senders.iter().map(made).sum();
            let accounted = reader.sum(|r| &r.received, topic) + reader.sum(|r| &r.lost, topic);
            (Some(made.saturating_sub(accounted)), Some(made))
        };
        (lost != Some(0)).then(|| LostInCrash { topic: topic.to_owned(), node: node.to_owned(), lost, sent })
    })
}

/// Returns what `find` tells of each node and each topic that it reads: it gets the name of the node, its lives, the topic, and the
/// nodes that write it.
pub(super) fn of_readings<T>(
    reports: &[NodeReport],
    find: impl Fn(&str, &Lives<'_>, &str, &[&Lives<'_>]) -> Option<T>,
) -> Vec<T> {
    let nodes = Lives::of_nodes(reports);
    let mut found = Vec::new();
    for (name, reader) in &nodes {
        for topic in reader.reads() {
            let senders: Vec<&Lives<'_>> = nodes.values().filter(|node| node.writes(topic)).collect();
            found.extend(find(name, reader, topic, &senders));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(counts: &[(&str, u64)]) -> BTreeMap<String, u64> {
        counts.iter().map(|(topic, n)| ((*topic).to_owned(), *n)).collect()
    }

    fn camera(published: u64, unwanted: u64) -> NodeReport {
        let (published, unwanted) = (counts(&[("/modulo", published)]), counts(&[("/modulo", unwanted)]));
        NodeReport { published, unwanted, ..NodeReport::new("/camera") }
    }

    fn reader(topics: &[(&str, u64)]) -> NodeReport {
        NodeReport { received: counts(topics), ..NodeReport::new("/unwrap") }
    }

    fn crashed(life: NodeReport) -> NodeReport {
        NodeReport { running: true, ..life }
    }

    fn lines(reports: &[NodeReport]) -> Vec<String> {
        losses(reports).iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_reader_that_crashed_misses_what_no_life_of_it_has_received() {
        let lives =
            |second| [camera(290, 10), crashed(reader(&[("/modulo", 100)])), reader(&[("/modulo", second)])];
        assert_eq!(lines(&lives(187)), ["lost in a crash: 13 of 300 frames of /modulo at /unwrap"]);
        assert_eq!(lines(&lives(200)), [""; 0]);
        let mut lossy = lives(187);
        lossy[2].lost = counts(&[("/modulo", 12)]);
        assert_eq!(lines(&lossy), ["lost in a crash: 1 of 300 frames of /modulo at /unwrap"]);
    }

    #[test]
    fn a_sender_that_crashed_has_counted_a_frame_that_it_did_not_send() {
        let lives = [crashed(camera(101, 0)), camera(199, 0), reader(&[("/modulo", 299)])];
        assert_eq!(lines(&lives), ["lost in a crash: 1 of 300 frames of /modulo at /unwrap"]);
    }

    #[test]
    fn without_a_crash_nothing_is_lost_in_one() {
        // A reader that joined late.
        assert_eq!(lines(&[camera(290, 10), reader(&[("/modulo", 100)])]), [""; 0]);
    }

    #[test]
    fn a_life_that_never_subscribed_changes_nothing() {
        let lives = [
            camera(20, 10),
            crashed(reader(&[])),
            crashed(reader(&[("/modulo", 8)])),
            reader(&[("/modulo", 12)]),
        ];
        assert_eq!(lines(&lives), ["lost in a crash: 10 of 30 frames of /modulo at /unwrap"]);
    }

    #[test]
    fn the_number_is_unknown_where_inputs_changed_or_the_sender_keeps_no_account() {
        let unknown = "lost in a crash: an unknown number of frames of /modulo at /unwrap";
        let lives = [crashed(reader(&[("/modulo", 100)])), reader(&[("/modulo", 80)])];
        assert_eq!(lines(&lives), [unknown], "a recording that is played");
        let swapped = NodeReport { swapped: true, ..lives[0].clone() };
        assert_eq!(lines(&[camera(200, 0), swapped, lives[1].clone()]), [unknown]);
        let other = reader(&[("/ideal", 80)]);
        let found = lines(&[camera(200, 0), lives[0].clone(), other]);
        assert!(found.contains(&unknown.to_owned()), "{found:?}");
    }
}
