//! [`Inputs`]: the present subscriptions of a live node, a lane of its queue each, and [`SkipWarnings`]: warnings of
//! the messages on them that could not be read.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::{EventQueue, LiveEvent};
use crate::driver::keeps_latest;
use crate::graph::{NodeName, Qos};
use crate::report::{NodeReport, add};
use crate::transport::queue::{Keep, Lane, LaneCounts};
use crate::transport::{Address, Guard, Transport, TransportError};

/// Messages of a results topic that wait for a busy node.
const RESULTS_WAITING: usize = 64;

/// Renewed as a whole when the node's inputs change.
#[derive(Default)]
pub(super) struct Inputs {
    pub addresses: Vec<Address>,
    lanes: Vec<Lane>,
    subscriptions: Vec<Guard>,
}

impl Inputs {
    /// Subscribes the node `node_name` to `addresses`.
    pub fn subscribe(
        addresses: Vec<Address>,
        node_name: &NodeName,
        transport: &dyn Transport,
        queue: &Arc<EventQueue>,
    ) -> Result<Self, TransportError> {
        let mut inputs = Self { addresses, ..Self::default() };
        for address in &inputs.addresses {
            // A newer image makes an older one useless, but each result counts.
            let keep = if keeps_latest(address.kind) { Keep::Latest } else { Keep::Last(RESULTS_WAITING) };
            let lane = queue.open(keep);
            inputs.lanes.push(lane);
            let queue = queue.clone();
            let deliver = Box::new(move |incoming| drop(queue.push(lane, LiveEvent::Message(incoming))));
            inputs.subscriptions.push(transport.subscribe(node_name, address, deliver)?);
        }
        Ok(inputs)
    }

    /// Returns the index of the input whose messages come in `lane`; `None` for a lane of earlier inputs.
    pub fn index_of(&self, lane: Lane) -> Option<usize> {
        self.lanes.iter().position(|&open| open == lane)
    }

    /// Adds the counts of these subscriptions so far to `report`; messages that still wait do not count as received.
    pub fn count(&self, queue: &EventQueue, report: &mut NodeReport) {
        for (address, &lane) in self.addresses.iter().zip(&self.lanes) {
            let counts = queue.counts(lane);
            book(
                report,
                address,
                LaneCounts { received: counts.received - counts.unread, unread: 0, ..counts },
            );
        }
    }

    /// Ends the subscriptions and adds their counts to `report`.
    pub fn close(mut self, queue: &EventQueue, report: &mut NodeReport) {
        self.subscriptions.clear();
        for (address, &lane) in self.addresses.iter().zip(&self.lanes) {
            book(report, address, queue.close(lane));
        }
    }
}

fn book(report: &mut NodeReport, Address { topic, qos, .. }: &Address, counts: LaneCounts) {
    // A message without room in the queue counts as lost on its way, not as received.
    add(&mut report.received, topic, counts.received - counts.overflowed);
    add(&mut report.replaced, topic, counts.replaced);
    add(&mut report.lost, topic, counts.lost());
    add(&mut report.unread, topic, counts.unread);
    let of_its_kind = match qos {
        Qos::Images | Qos::Clock => &mut report.best_effort,
        Qos::Latched => &mut report.latched,
        Qos::Results | Qos::Events | Qos::Logs => return,
    };
    of_its_kind.insert(topic.clone());
}

/// Shortest time between two warnings about one topic.
const WARNING_PERIOD_NS: u64 = 1_000_000_000;

/// Warns of skipped messages at most once a second for each topic, with the number of those that were not told. A
/// publisher whose images cannot be read would otherwise fill the log at its rate.
#[derive(Default)]
pub(super) struct SkipWarnings {
    /// By topic: ticks of the last warning, and the number of skipped messages since then.
    topics: BTreeMap<String, (u64, u64)>,
}

impl SkipWarnings {
    /// Notes that a message of `topic` was skipped at the ticks `now`; returns the text of a warning if one is due.
    pub fn note(&mut self, topic: &str, why: &str, now: u64) -> Option<String> {
        let Some((last, untold)) = self.topics.get_mut(topic) else {
            self.topics.insert(topic.to_owned(), (now, 0));
            return Some(format!("skipped: {why}"));
        };
        *untold += 1;
        if now.saturating_sub(*last) < WARNING_PERIOD_NS {
            return None;
        }
        *last = now;
        Some(match std::mem::take(untold) {
            1 => format!("skipped: {why}"),
            count => format!("skipped: {why} (one of {count} since the last warning)"),
        })
    }

    /// Returns each topic with skipped messages that no warning has counted, with the text of the last warning.
    pub fn rest(&mut self) -> Vec<(String, String)> {
        let topics = std::mem::take(&mut self.topics).into_iter();
        let untold = topics.filter(|(_, (_, untold))| *untold > 0);
        untold.map(|(topic, (_, n))| (topic, format!("skipped: {n} more since the last warning"))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skipped_messages_are_told_once_a_second_and_none_is_left_out_of_the_count() {
        const MS: u64 = 1_000_000;
        let mut warnings = SkipWarnings::default();
        assert_eq!(warnings.note("/a", "cut", 0).as_deref(), Some("skipped: cut"));
        assert_eq!(warnings.note("/b", "cut", 10 * MS).as_deref(), Some("skipped: cut"), "another topic");
        assert_eq!(warnings.note("/a", "odd", 500 * MS), None);
        assert_eq!(warnings.note("/a", "odd", 999 * MS), None);
        let told = warnings.note("/a", "cut", 1000 * MS);
        assert_eq!(told.as_deref(), Some("skipped: cut (one of 3 since the last warning)"));
        assert_eq!(warnings.note("/a", "odd", 9000 * MS).as_deref(), Some("skipped: odd"));
        assert_eq!(warnings.note("/a", "odd", 9001 * MS), None);
        assert_eq!(warnings.rest(), [("/a".to_owned(), "skipped: 1 more since the last warning".to_owned())]);
        assert_eq!(warnings.rest(), []);
    }
}
