//! [`Inputs`]: the present subscriptions of a live node, a lane of its queue each.

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
