//! The loop of a listener: each message that it admits is one step, until its upstream has ended.

use std::collections::BTreeMap;
use std::sync::Arc;

use modulo_msgs::std_msgs::Time;
use modulo_runtime::{Address, Clock, Flow, Message, MessageKind, Topic, Trigger, Urgency};

use super::outputs::decompress;
use super::source::images;
use super::{GRAPH_GLANCE, IDLE, Live, LiveEvent, nanoseconds};
use crate::driver::RunError;
use crate::driver::pacing::taken_message;
use crate::transport::Incoming;
use crate::transport::queue::{Arrived, Lane, Next, Queued as _};

/// A draining node gives up this long after its last message, even if its upstream is still there.
const DRAIN_LIMIT_NS: u64 = 2_000_000_000;
/// After this many late messages on one topic the upstream node is considered to be running on, and the drain ends. An upstream
/// node that ends as well still sends the message that it works on and the one that waits for it.
const LATE_MESSAGES: u32 = 4;
/// A message that a step has kept is given up after this long.
const KEPT_LIMIT_NS: u64 = 1_000_000_000;

/// The time after a node with messages in its queue was asked to end.
struct Drain {
    /// Its start, ns of the machine's clock.
    start_ns: u64,
    /// Number of messages that came after its limit, by topic.
    late: BTreeMap<String, u32>,
}

impl Live<'_> {
    pub(super) fn run_listener(&mut self) -> Result<(), RunError> {
        // When the last message came, or the drain began; and since when no publisher is left.
        let (mut quiet_since, mut alone_since) = (None, None);
        let mut drain = None;
        loop {
            let draining = match self.stop.urgency() {
                Urgency::Now => return Ok(()),
                Urgency::Drain => true,
                Urgency::None => false,
            };
            match self.queue.take(Some(if draining { GRAPH_GLANCE } else { IDLE })) {
                Next::Item(arrived) => {
                    let goes_on = draining && self.upstream_goes_on(&arrived, &mut drain);
                    // Handled in any case: it has left the queue, where it would count as unread.
                    let flow = self.handle(arrived)?;
                    if goes_on || flow == Flow::Done || self.node.period().is_some() {
                        return Ok(());
                    }
                    // Each message restarts both waits, since more may follow it.
                    (quiet_since, alone_since) = (None, None);
                }
                Next::Idle | Next::Ended if draining => {
                    let now = self.time.ticks_ns();
                    // Counted from the first idle moment after a message or after the request to end.
                    let quiet = now - *quiet_since.get_or_insert(now);
                    let alone =
                        if self.has_upstream() { None } else { Some(*alone_since.get_or_insert(now)) };
                    // A message may still be on its way after the token of its publisher has gone.
                    let settled =
                        alone.is_some_and(|since| now - since >= nanoseconds(self.transport.settling()));
                    if settled || quiet > DRAIN_LIMIT_NS {
                        return Ok(());
                    }
                }
                Next::Idle | Next::Ended => self.tell_when_due(),
            }
        }
    }

    /// Returns whether a publisher of an input sends as before, although this node was asked to end. `drain` holds the start
    /// of the drain, and the number of messages that came late in it, by topic. Messages that waited for a slow step came in time.
    fn upstream_goes_on(&self, arrived: &Arrived<LiveEvent>, drain: &mut Option<Drain>) -> bool {
        let drain =
            drain.get_or_insert_with(|| Drain { start_ns: self.time.machine_ns(), late: BTreeMap::new() });
        let Some((_, input)) = self.inputs.of(arrived.lane) else { return false };
        if arrived.stamp_ns <= drain.start_ns + DRAIN_LIMIT_NS {
            return false;
        }
        let late = drain.late.entry(input.address.topic.clone()).or_default();
        *late += 1;
        *late > LATE_MESSAGES
    }

    /// Returns whether more messages can come.
    fn has_upstream(&self) -> bool {
        self.inputs.topics().any(|topic| !self.transport.publishers(topic).is_empty())
    }

    pub(super) fn handle_message(
        &mut self,
        lane: Lane,
        arrived_ns: u64,
        incoming: Incoming,
    ) -> Result<Flow, RunError> {
        let (input, read) = self.inputs.of(lane).expect("a lane is closed together with its input");
        let (declared, Address { topic, kind, .. }) = (read.topic.clone(), read.address.clone());
        self.watch.arrived(&topic, incoming.attachment(), arrived_ns);
        let begin = self.time.ticks_ns();
        let opened = incoming.open(kind).map_err(|why| why.to_string());
        let message = match opened.and_then(|message| decompressed(&declared, message)) {
            Ok(message) => message,
            Err(why) => {
                self.skip(&topic, &why);
                self.watch.unreadable(&topic, begin, self.time.ticks_ns());
                return Ok(Flow::Continue);
            }
        };
        if !self.inputs.admit(lane, message.stamp(), self.time.ticks_ns(), &mut self.telemetry.report) {
            return Ok(Flow::Continue);
        }
        // The stamp is kept, because the step consumes the message.
        let frame = (message.kind() == MessageKind::Image).then(|| message.stamp());
        self.telemetry.span("decode", begin, self.time.ticks_ns(), frame);
        let told = frame.filter(|_| self.taken.wanted());
        let passes_on = self.outputs.iter().any(|o| o.address.kind == MessageKind::Image && o.wanted());
        // Before the step: the source can make the next frame while this one is worked on.
        if let Some(stamp) = told.filter(|_| !passes_on) {
            self.tell_taken(stamp, &[]);
        }
        let trigger = Trigger::Message { input, message };
        let (flow, messages) = self.step(trigger, &topic, Some(&declared.name), frame)?;
        if frame.is_some() {
            self.watch.answered(&topic, begin, self.time.ticks_ns());
        }
        self.send_all(&messages);
        if flow == Flow::NewInputs {
            self.subscribe()?;
        }
        if let (Flow::Kept, Some(stamp)) = (flow, frame) {
            self.kept = Some((stamp, topic, begin));
        } else if !messages.is_empty() {
            self.kept = None;
        }
        // A frame that is kept has no result yet; the step that answers it tells.
        if passes_on && flow != Flow::Kept {
            self.tell_passed_on(told, &messages);
        }
        Ok(flow)
    }

    /// Tells sources of rate 0 that the frame of the stamp `told` was answered by these messages.
    fn tell_passed_on(&self, told: Option<Time>, messages: &[(usize, Message)]) {
        if !self.taken.wanted() {
            return;
        }
        let sent = images(messages, &self.outputs);
        if let Some((stamp, topics)) = sent.or(told.map(|stamp| (stamp, Vec::new()))) {
            self.tell_taken(stamp, &topics);
        }
    }

    /// Gives the kept frame up when it has waited long enough, so that a source of rate 0 goes on.
    pub(super) fn give_up_kept(&mut self) {
        let now = self.time.ticks_ns();
        let Some((stamp, topic, _)) =
            self.kept.take_if(|(_, _, since)| now.saturating_sub(*since) >= KEPT_LIMIT_NS)
        else {
            return;
        };
        if let Some(why) = self.node.give_up() {
            self.skip(&topic, &why);
            if self.taken.wanted() {
                self.tell_taken(stamp, &[]);
            }
        }
    }

    fn tell_taken(&self, stamp: Time, topics: &[String]) {
        let own = self.transport.id_of(&self.node_name);
        if let Err(why) = self.taken.put(&taken_message(own, stamp, topics)) {
            tracing::warn!(node = %self.telemetry.node(), "{why}");
        }
    }
}

/// Returns the image of a message that came on the compressed variant of `topic`, and any other message as it is.
fn decompressed(topic: &Topic, message: Message) -> Result<Message, String> {
    match &message {
        Message::CompressedImage(file) if topic.kind == MessageKind::Image => {
            Ok(Message::Image(Arc::new(decompress(file, topic)?)))
        }
        _ => Ok(message),
    }
}
