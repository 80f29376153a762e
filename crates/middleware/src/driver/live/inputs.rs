//! [`Inputs`]: the present subscriptions of a live node, a lane of its queue each.

use std::sync::Arc;

use modulo_msgs::std_msgs::Time;
use modulo_runtime::report::add;
use modulo_runtime::{Address, MessageKind, NodeName, NodeReport, Topic};

use super::swap::{Slot, SlotInput, book};
use super::{EventQueue, LiveEvent};
use crate::transport::queue::{Keep, Lane, LaneCounts};
use crate::transport::{Transport, TransportError};

/// Messages of a results topic that wait for a busy node.
const RESULTS_WAITING: usize = 64;

/// An input after a [`Renewal`].
struct PlannedInput {
    topic: Topic,
    address: Address,
    /// The slot that it takes over; `None` for one of its own.
    slot: Option<usize>,
    /// Its subscription, if none is open.
    opened: Option<SlotInput>,
}

/// The next inputs of a node, in the order of its topics, with the subscriptions that they need in addition, which end with it
/// unless it is used.
pub(super) struct Renewal(Vec<PlannedInput>);

pub(super) struct Inputs<'a> {
    transport: &'a dyn Transport,
    queue: Arc<EventQueue>,
    slots: Vec<Slot>,
}

impl<'a> Inputs<'a> {
    /// Returns a node's inputs before its first subscription.
    pub fn new(transport: &'a dyn Transport, queue: Arc<EventQueue>) -> Self {
        Self { transport, queue, slots: Vec::new() }
    }

    /// Subscribes to those of `topics` that are not open yet. The inputs stay as they are until [`Inputs::renew`].
    pub fn open(
        &self,
        topics: Vec<(Topic, Address)>,
        node_name: &NodeName,
    ) -> Result<Renewal, TransportError> {
        let slots = self.slots_of(&topics);
        let open = |((topic, address), slot): ((Topic, Address), Option<usize>)| {
            let is_open = slot.is_some_and(|slot| self.slots[slot].reads(&address));
            let open = || subscribe(topic.clone(), address.clone(), node_name, self.transport, &self.queue);
            let opened = (!is_open).then(open).transpose()?;
            Ok(PlannedInput { topic, address, slot, opened })
        };
        Ok(Renewal(topics.into_iter().zip(slots).map(open).collect::<Result<_, _>>()?))
    }

    /// Returns for each of `topics` the slot that it takes over, if any; found by address, since indices change.
    fn slots_of(&self, topics: &[(Topic, Address)]) -> Vec<Option<usize>> {
        let rules: [fn(&Slot, &Address) -> bool; 3] = [
            |slot, address| slot.current().address == *address,
            Slot::reads,
            // An image stream takes the place of another one: both lists are in the order of the cameras.
            |slot, address| is_image(slot.current().address.kind) && is_image(address.kind),
        ];
        let mut found = vec![None; topics.len()];
        for fits in rules {
            for (index, (_, address)) in topics.iter().enumerate() {
                let mut slots = (0..self.slots.len()).filter(|slot| !found.contains(&Some(*slot)));
                let slot = slots.find(|&slot| fits(&self.slots[slot], address));
                found[index] = found[index].or(slot);
            }
        }
        found
    }

    /// Changes to the inputs of `renewal` at the ticks `now`. A new image topic replaces the old one with its first image.
    pub fn renew(&mut self, renewal: Renewal, now: u64, report: &mut NodeReport) {
        let mut before: Vec<Option<Slot>> = std::mem::take(&mut self.slots).into_iter().map(Some).collect();
        let mut closed = Vec::new();
        for PlannedInput { topic, address, slot, opened } in renewal.0 {
            let slot = slot.map(|slot| before[slot].take().expect("each slot has one successor"));
            self.slots.push(match (slot, opened) {
                (None, opened) => Slot::new(opened.expect("no slot reads it yet")),
                (Some(mut slot), opened) => {
                    report.swapped |= slot.current().address != address;
                    closed.extend(slot.change(topic, &address, opened, now));
                    slot
                }
            });
        }
        let left: Vec<Slot> = before.into_iter().flatten().collect();
        report.swapped |= !left.is_empty();
        closed.extend(left.into_iter().flat_map(Slot::into_inputs));
        closed.into_iter().for_each(|input| input.close(self.transport, false, report));
    }

    fn all(&self) -> impl Iterator<Item = &SlotInput> {
        self.slots.iter().flat_map(Slot::inputs)
    }

    /// Returns the names of all topics that are subscribed now.
    pub fn topics(&self) -> impl Iterator<Item = &str> {
        self.all().map(|input| input.address.topic.as_str())
    }

    /// Returns the input that is open in `lane`, with its index in the node's list; `None` for a closed one.
    pub fn of(&self, lane: Lane) -> Option<(usize, &SlotInput)> {
        let slots = self.slots.iter().enumerate();
        let mut inputs = slots.flat_map(|(index, slot)| slot.inputs().map(move |input| (index, input)));
        inputs.find(|(_, input)| input.lane == lane)
    }

    /// Returns the topics of the images that are waited for.
    pub fn image_topics(&self) -> impl Iterator<Item = &str> + Clone {
        let inputs = self.slots.iter().map(Slot::current);
        let images = inputs.filter(|input| input.topic.kind == MessageKind::Image);
        images.map(|input| input.address.topic.as_str())
    }

    /// Returns the names of the image streams whose frames are answered now, as the node declares them, with commas.
    pub fn stream(&self) -> Option<String> {
        let streams = self.slots.iter().map(Slot::in_use).filter(|topic| topic.kind == MessageKind::Image);
        let names: Vec<_> = streams.map(|topic| topic.name.as_str()).collect();
        (!names.is_empty()).then(|| names.join(", "))
    }

    /// Returns whether a message of `stamp` from `lane` is answered at the ticks `now`; if not, it counts as replaced.
    pub fn admit(&mut self, lane: Lane, stamp: Time, now: u64, report: &mut NodeReport) -> bool {
        let Some((index, input)) = self.of(lane) else { return false };
        let topic = input.address.topic.clone();
        let (answered, closed) = self.slots[index].admit(lane, stamp.as_ns(), now);
        if !answered {
            add(&mut report.replaced, &topic, 1);
        }
        closed.into_iter().for_each(|input| input.close(self.transport, false, report));
        answered
    }

    /// Returns the warnings about streams without a frame at the ticks `now`, and closes streams that the node has left.
    pub fn look(&mut self, now: u64, report: &mut NodeReport) -> Vec<String> {
        let mut warnings = Vec::new();
        for slot in &mut self.slots {
            let (warning, closed) = slot.look(now);
            warnings.extend(warning);
            closed.into_iter().for_each(|input| input.close(self.transport, false, report));
        }
        warnings
    }

    /// Adds the counts of these subscriptions so far to `report`; messages that still wait do not count as received.
    pub fn count(&self, report: &mut NodeReport) {
        for input @ SlotInput { address, lane, .. } in self.all() {
            input.hear(self.transport, true, report);
            let counts = self.queue.counts(*lane);
            book(
                report,
                address,
                LaneCounts { received: counts.received - counts.unread, unread: 0, ..counts },
            );
        }
    }

    /// Ends all subscriptions and adds their counts to `report`; `lasted` is whether the node ends as well.
    pub fn close(&mut self, lasted: bool, report: &mut NodeReport) {
        let inputs = std::mem::take(&mut self.slots).into_iter().flat_map(Slot::into_inputs);
        inputs.for_each(|input| input.close(self.transport, lasted, report));
    }
}

fn subscribe(
    topic: Topic,
    address: Address,
    node_name: &NodeName,
    transport: &dyn Transport,
    queue: &Arc<EventQueue>,
) -> Result<SlotInput, TransportError> {
    // A newer image makes an older one useless, but each result counts.
    let latest = is_image(address.kind) || address.kind == MessageKind::CameraInfo;
    let keep = if latest { Keep::Latest } else { Keep::Last(RESULTS_WAITING) };
    let (lane, waiting) = (queue.open(keep), queue.clone());
    let deliver = Box::new(move |incoming| drop(waiting.push(lane, LiveEvent::Message(incoming))));
    let subscription = transport.subscribe(node_name, &address, deliver)?;
    Ok(SlotInput { topic, address, lane, queue: queue.clone(), subscription: Some(subscription) })
}

fn is_image(kind: MessageKind) -> bool {
    matches!(kind, MessageKind::Image | MessageKind::CompressedImage)
}
