//! [`Inputs`]: the present subscriptions of a live node and what waits in them.

use std::sync::Arc;

use crate::driver::keeps_latest;
use crate::inbox::{Inbox, Keep};
use crate::name::Place;
use crate::report::{NodeReport, add};
use crate::transport::{Address, Inlet, Parcel, Transport, TransportError};

/// Messages of a results topic that wait for a busy node.
const RESULTS_WAITING: usize = 64;

/// Renewed as a whole when the node's inputs change.
pub(super) struct Inputs {
    pub addresses: Vec<Address>,
    pub inbox: Arc<Inbox<Parcel>>,
    inlets: Vec<Box<dyn Inlet>>,
}

impl Inputs {
    pub fn none() -> Self {
        Self { addresses: Vec::new(), inbox: Arc::new(Inbox::new(&[])), inlets: Vec::new() }
    }

    /// Subscribes the node at `place` to `addresses`.
    pub fn subscribe(
        addresses: Vec<Address>,
        place: &Place,
        transport: &dyn Transport,
    ) -> Result<Self, TransportError> {
        let keep: Vec<Keep> = addresses
            .iter()
            .map(|a| if keeps_latest(a.kind) { Keep::Latest } else { Keep::Last(RESULTS_WAITING) })
            .collect();
        let inbox = Arc::new(Inbox::new(&keep));
        let inlets = addresses
            .iter()
            .enumerate()
            .map(|(slot, address)| transport.subscribe(place, address, inbox.clone(), slot))
            .collect::<Result<_, _>>()?;
        Ok(Self { addresses, inbox, inlets })
    }

    /// Ends the subscriptions and books what they received and lost.
    pub fn account(self, report: &mut NodeReport) {
        for (slot, address) in self.addresses.iter().enumerate() {
            let tally = self.inbox.tally(slot);
            let lost = self.inlets.get(slot).map_or(0, |inlet| inlet.lost());
            add(&mut report.received, &address.topic, tally.received);
            add(&mut report.dropped, &address.topic, tally.dropped + lost);
        }
    }
}
