//! [`ForeignMessages`]: messages that nodes outside of the launch have sent on its topics, as a second suite in the domain does.

use std::fmt;

use serde::Serialize;

use super::NodeReport;
use super::crash::of_readings;

/// Messages of one topic that a node has received from outside of the launch: its results are not those of one camera.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ForeignMessages {
    /// The topic.
    pub topic: String,
    /// The node that reads it.
    pub node: String,
    /// How many came from outside, at least.
    pub foreign: u64,
    /// How many came in all.
    pub received: u64,
}

impl fmt::Display for ForeignMessages {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { topic, node, foreign, received } = self;
        write!(f, "not of this launch: {foreign} of {received} messages of {topic} at {node}")
    }
}

/// Computes the messages that no node of the launch has sent, for each reader of each topic that one of them publishes:
/// `received + lost - sent`, where that is above zero. A topic whose publisher has crashed is left out.
pub(super) fn foreign(reports: &[NodeReport]) -> Vec<ForeignMessages> {
    of_readings(reports, |node, reader, topic, senders| {
        if senders.is_empty() || senders.iter().any(|sender| sender.crashed()) {
            return None;
        }
        let sent: u64 = senders.iter().map(|sender| sender.sum(|life| &life.published, topic)).sum();
        let received = reader.sum(|life| &life.received, topic);
        let foreign = (received + reader.sum(|life| &life.lost, topic)).saturating_sub(sent);
        let (topic, node) = (topic.to_owned(), node.to_owned());
        (foreign > 0).then_some(ForeignMessages { topic, node, foreign, received })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two suites in one domain gave one summary with the boxes of both cameras, and nothing said so.
    #[test]
    fn what_no_node_of_the_launch_has_sent_is_named() {
        let node = |name: &str, received: u64, lost: u64, published: u64| {
            let of = |topic: &str, count| [(topic.to_owned(), count)].into();
            NodeReport {
                received: of("/modulo", received),
                lost: of("/modulo", lost),
                published: of(if received > 0 { "/recovered" } else { "/modulo" }, published),
                ..NodeReport::new(name)
            }
        };
        let camera = NodeReport { received: [].into(), lost: [].into(), ..node("/camera", 0, 0, 30) };
        let lines = |reports: &[NodeReport]| -> Vec<String> {
            foreign(reports).iter().map(ToString::to_string).collect()
        };
        let line = |foreign, received| {
            vec![format!("not of this launch: {foreign} of {received} messages of /modulo at /unwrap")]
        };
        assert_eq!(lines(&[camera.clone(), node("/unwrap", 60, 0, 60)]), line(30, 60));
        assert_eq!(lines(&[camera.clone(), node("/unwrap", 25, 10, 25)]), line(5, 25));
        for (received, lost) in [(30, 0), (10, 20), (12, 0)] {
            assert_eq!(lines(&[camera.clone(), node("/unwrap", received, lost, 9)]), [""; 0]);
        }
        // A restart of the reader, a topic of a camera outside, and a camera that crashed.
        let lives = [camera.clone(), node("/unwrap", 10, 0, 10), node("/unwrap", 20, 0, 20)];
        assert_eq!(lines(&lives), [""; 0]);
        assert_eq!(lines(&[node("/unwrap", 60, 0, 60)]), [""; 0]);
        let crashed = NodeReport { running: true, ..camera };
        assert_eq!(lines(&[crashed, node("/unwrap", 60, 0, 60)]), [""; 0]);
    }
}
