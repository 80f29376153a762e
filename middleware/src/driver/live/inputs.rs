//! [`Inputs`]: the present subscriptions of a live node, a lane of its queue each, and [`SkipWarnings`]: warnings of
//! the messages on them that could not be read; [`Silence`]: the warning that no image comes.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use modulo_msgs::std_msgs::Time;
use modulo_runtime::clock::nanos;
use modulo_runtime::report::add;
use modulo_runtime::{Address, MessageKind, NodeName, NodeReport, Qos, Topic};

use super::swap::{Slot, SlotInput};
use super::{EventQueue, LiveEvent};
use crate::driver::keeps_latest;
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

/// The next inputs of a node, in the order of its topics, with the subscriptions that they need in addition.
pub(super) struct Renewal(Vec<PlannedInput>);

/// The subscriptions of a node.
pub(super) struct Inputs {
    queue: Arc<EventQueue>,
    slots: Vec<Slot>,
}

impl Inputs {
    /// Returns a node's inputs before its first subscription.
    pub fn new(queue: Arc<EventQueue>) -> Self {
        Self { queue, slots: Vec::new() }
    }

    /// Subscribes the node `node_name` to those of `topics` that are not open yet. The inputs stay as they are until
    /// [`Inputs::renew`].
    pub fn open(
        &self,
        topics: Vec<(Topic, Address)>,
        node_name: &NodeName,
        transport: &dyn Transport,
    ) -> Result<Renewal, TransportError> {
        let slots = self.slots_of(&topics);
        let open = |((topic, address), slot): ((Topic, Address), Option<usize>)| {
            let is_open = slot.is_some_and(|slot| self.slots[slot].reads(&address));
            let open = || subscribe(topic.clone(), address.clone(), node_name, transport, &self.queue);
            let opened = (!is_open).then(open).transpose()?;
            Ok(PlannedInput { topic, address, slot, opened })
        };
        Ok(Renewal(topics.into_iter().zip(slots).map(open).collect::<Result<_, _>>()?))
    }

    /// Returns for each of `topics` the slot that it takes over, if any. A slot is found by its address: its index depends on
    /// the inputs before it.
    fn slots_of(&self, topics: &[(Topic, Address)]) -> Vec<Option<usize>> {
        let rules: [fn(&Slot, &Address) -> bool; 3] = [
            |slot, address| slot.current.address == *address,
            Slot::reads,
            // An image stream takes the place of another one: both lists are in the order of the cameras.
            |slot, address| is_image(slot.current.address.kind) && is_image(address.kind),
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

    /// Takes the inputs of `renewal`, and leaves all others, at the ticks `now`. An image topic that takes the place of
    /// another one takes over with its first image.
    pub fn renew(&mut self, renewal: Renewal, now: u64, report: &mut NodeReport) {
        let mut before: Vec<Option<Slot>> = std::mem::take(&mut self.slots).into_iter().map(Some).collect();
        let mut closed = Vec::new();
        for PlannedInput { topic, address, slot, opened } in renewal.0 {
            let slot = slot.map(|slot| before[slot].take().expect("each slot has one successor"));
            self.slots.push(match (slot, opened) {
                (None, opened) => Slot::new(opened.expect("no slot reads it yet")),
                (Some(mut slot), opened) => {
                    report.swapped |= slot.current.address != address;
                    closed.extend(slot.change(topic, &address, opened, now));
                    slot
                }
            });
        }
        let left: Vec<Slot> = before.into_iter().flatten().collect();
        report.swapped |= !left.is_empty();
        closed.extend(left.into_iter().flat_map(Slot::into_inputs));
        closed.into_iter().for_each(|input| input.close(&self.queue, report));
    }

    /// Ends the subscriptions that `renewal` has opened; the inputs stay as they are.
    pub fn cancel(&self, renewal: Renewal) {
        renewal
            .0
            .into_iter()
            .filter_map(|planned| planned.opened)
            .for_each(|input| input.cancel(&self.queue));
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
        let inputs = self.slots.iter().map(|slot| &slot.current);
        let images = inputs.filter(|input| input.topic.kind == MessageKind::Image);
        images.map(|input| input.address.topic.as_str())
    }

    /// Returns the name of the image stream whose frames are answered now, as the node declares it; those of several
    /// cameras with commas between them.
    pub fn stream(&self) -> Option<String> {
        let streams = self.slots.iter().map(Slot::in_use).filter(|topic| topic.kind == MessageKind::Image);
        let names: Vec<_> = streams.map(|topic| topic.name.as_str()).collect();
        (!names.is_empty()).then(|| names.join(", "))
    }

    /// Returns whether a message of `stamp` that came in `lane` is answered at the ticks `now`. One that is not counts
    /// as replaced in `report`.
    pub fn admit(&mut self, lane: Lane, stamp: Time, now: u64, report: &mut NodeReport) -> bool {
        let Some((index, input)) = self.of(lane) else { return false };
        let topic = input.address.topic.clone();
        let (answered, closed) = self.slots[index].admit(lane, stamp.as_ns(), now);
        if !answered {
            add(&mut report.replaced, &topic, 1);
        }
        closed.into_iter().for_each(|input| input.close(&self.queue, report));
        answered
    }

    /// Returns the warnings about streams that have given no frame since the node asked for them, at the ticks `now`, and
    /// closes streams that the node has left.
    pub fn look(&mut self, now: u64, report: &mut NodeReport) -> Vec<String> {
        let mut warnings = Vec::new();
        for slot in &mut self.slots {
            let (warning, closed) = slot.look(now);
            warnings.extend(warning);
            closed.into_iter().for_each(|input| input.close(&self.queue, report));
        }
        warnings
    }

    /// Adds the counts of these subscriptions so far to `report`; messages that still wait do not count as received.
    pub fn count(&self, report: &mut NodeReport) {
        for SlotInput { address, lane, .. } in self.all() {
            let counts = self.queue.counts(*lane);
            book(
                report,
                address,
                LaneCounts { received: counts.received - counts.unread, unread: 0, ..counts },
            );
        }
    }

    /// Ends all subscriptions and adds their counts to `report`.
    pub fn close(&mut self, report: &mut NodeReport) {
        let inputs = std::mem::take(&mut self.slots).into_iter().flat_map(Slot::into_inputs);
        inputs.for_each(|input| input.close(&self.queue, report));
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
    let keep = if keeps_latest(address.kind) { Keep::Latest } else { Keep::Last(RESULTS_WAITING) };
    let (lane, waiting) = (queue.open(keep), queue.clone());
    let deliver = Box::new(move |incoming| drop(waiting.push(lane, LiveEvent::Message(incoming))));
    let subscription = transport.subscribe(node_name, &address, deliver)?;
    Ok(SlotInput::new(topic, address, lane, subscription))
}

fn is_image(kind: MessageKind) -> bool {
    matches!(kind, MessageKind::Image | MessageKind::CompressedImage)
}

pub(super) fn book(report: &mut NodeReport, Address { topic, qos, .. }: &Address, counts: LaneCounts) {
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

/// A node that waits for an image for so long warns.
const PATIENCE: Duration = Duration::from_secs(2);

/// The waits of a node for the next image of each of its image topics. Only the time counts in which the node could have
/// taken one.
#[derive(Default)]
pub(super) struct Silence {
    waits: BTreeMap<String, Wait>,
}

/// The wait for the next image of one topic.
struct Wait {
    /// Ticks of its begin.
    since: u64,
    /// The warning, while it holds.
    told: Option<String>,
}

impl Silence {
    /// Returns the warning that holds now, of one of the topics.
    pub fn told(&self) -> Option<&str> {
        self.waits.values().find_map(|wait| wait.told.as_deref())
    }

    /// Notes that an image of `topic` was answered from the ticks `begin` to `now`. Returns a text when a warning was given
    /// before.
    pub fn end(&mut self, topic: &str, begin: u64, now: u64) -> Option<String> {
        let before = self.waits.get(topic)?.since;
        // Images of other topics could not be taken meanwhile.
        self.waits
            .values_mut()
            .for_each(|wait| wait.since = (wait.since + now.saturating_sub(begin)).min(now));
        let wait = self.waits.get_mut(topic)?;
        wait.since = now;
        wait.told.take()?;
        Some(format!("an image has come on {topic} after {} s", seconds(now, before)))
    }

    /// Returns the text of a warning if one is due at the ticks `now`: once, when no image has come on one of `topics` for
    /// 2 s. Publishers that are still starting are waited for without a warning.
    pub fn look<'a>(
        &mut self,
        topics: impl Iterator<Item = &'a str> + Clone,
        node: &str,
        transport: &dyn Transport,
        now: u64,
    ) -> Option<&str> {
        self.waits.retain(|waited, _| topics.clone().any(|topic| topic == waited));
        for topic in topics {
            // The images of a new input are waited for from now on.
            if !self.waits.contains_key(topic) {
                self.waits.insert(topic.to_owned(), Wait { since: now, told: None });
            }
        }
        let is_due = |wait: &Wait| wait.told.is_none() && now.saturating_sub(wait.since) >= nanos(PATIENCE);
        let (topic, wait) = self.waits.iter_mut().find(|(_, wait)| is_due(wait))?;
        let publishers = transport.publishers(topic);
        // A node announces itself when it is ready: a camera may wait for a detector that loads its model.
        if !publishers.is_empty() && !publishers.iter().any(|publisher| transport.is_ready(publisher)) {
            wait.since = now;
            return None;
        }
        let images = transport.published(MessageKind::Image).into_iter().filter(|(_, by)| by != node);
        let images: BTreeSet<String> = images.map(|(topic, _)| topic).collect();
        Some(wait.told.insert(warning(topic, &publishers, &images, seconds(now, wait.since))))
    }
}

fn seconds(now: u64, since: u64) -> u64 {
    Duration::from_nanos(now.saturating_sub(since)).as_secs()
}

fn warning(topic: &str, publishers: &[String], images: &BTreeSet<String>, seconds: u64) -> String {
    let cause = match publishers {
        [] => "no node publishes it".to_owned(),
        publishers => format!("{} publishes it, but sends nothing", publishers.join(", ")),
    };
    let kind = MessageKind::Image.type_name();
    let others = match images.iter().map(String::as_str).collect::<Vec<_>>() {
        images if images.is_empty() => format!("no topic of the type {kind} is published now"),
        images => format!("the published topics of the type {kind} are {}", images.join(", ")),
    };
    format!("no image has come on {topic} for {seconds} s: {cause}; {others}")
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
    use crate::transport::local::LocalTransport;

    #[test]
    fn a_silent_input_is_told_once_and_not_while_its_publisher_starts() {
        const S: u64 = 1_000_000_000;
        let transport = LocalTransport::default();
        let node = |name: &str| NodeName::new(name, "/", &[]).expect("a name");
        let image = |topic: &str| {
            Address::resolve(&node("unwrap"), &Topic::new(topic, MessageKind::Image)).expect("a name")
        };
        let own = transport.advertise(&node("unwrap"), &image("/recovered")).expect("local");
        let mut silence = Silence::default();
        let look = |silence: &mut Silence, topics: &[&str], now| {
            silence.look(topics.iter().copied(), "/unwrap", &transport, now).map(str::to_owned)
        };
        assert_eq!([0, 2 * S - 1].map(|now| look(&mut silence, &["/modulo"], now)), [None, None]);
        let told = look(&mut silence, &["/modulo"], 2 * S).expect("a warning");
        assert!(told.contains("no node publishes it; no topic of the type"), "{told}");
        assert_eq!((look(&mut silence, &["/modulo"], 9 * S), silence.told()), (None, Some(told.as_str())));
        let ended = silence.end("/modulo", 9 * S, 10 * S);
        assert_eq!(ended.as_deref(), Some("an image has come on /modulo after 10 s"));
        assert_eq!((silence.end("/modulo", 10 * S, 11 * S), silence.told()), (None, None));

        let camera = transport.advertise(&node("camera"), &image("/modulo")).expect("local");
        assert_eq!(look(&mut silence, &["/modulo"], 13 * S), None, "it is not ready yet");
        let ready = transport.announce(&node("camera")).expect("local");
        assert_eq!(look(&mut silence, &["/modulo"], 15 * S - 1), None);
        let told = look(&mut silence, &["/modulo"], 15 * S).expect("a warning");
        assert!(
            told.contains("/camera publishes it, but sends nothing") && told.ends_with("are /modulo"),
            "{told}"
        );
        assert_eq!(look(&mut silence, &["/other"], 16 * S), None, "another input");

        let both = ["/a", "/b"];
        assert_eq!(look(&mut silence, &both, 20 * S), None);
        // A long step for one camera is no silence of the other one.
        assert_eq!(silence.end("/a", 20 * S, 23 * S), None);
        assert_eq!(look(&mut silence, &both, 23 * S), None);
        assert_eq!(silence.end("/a", 25 * S, 25 * S), None);
        let told = look(&mut silence, &both, 25 * S).expect("a warning");
        assert!(told.contains("no image has come on /b for 2 s"), "{told}");
        drop((own, camera, ready));
    }

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
