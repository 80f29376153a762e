//! The loop of a listener: each message that it admits is one step, until its upstream has ended.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use modulo_msgs::std_msgs::Time;
use modulo_runtime::{Address, Clock, Flow, Message, MessageKind, Topic, Trigger, Urgency};

use super::outputs::decompress;
use super::source::images;
use super::{GRAPH_GLANCE, IDLE, Live, LiveEvent, nanoseconds};
use crate::driver::RunError;
use crate::driver::pacing::ack_message;
use crate::transport::Incoming;
use crate::transport::queue::{Arrived, Queued as _};

/// A node waits this long for messages that tell what it will get, where they are published, before it reports ready.
const UNTOLD: Duration = Duration::from_secs(1);
/// A draining node gives up this long after its last message, even if its upstream is still there.
const DRAIN_LIMIT_NS: u64 = 2_000_000_000;
/// After this many late messages on one topic the upstream node is considered to be running on, and the drain ends. An upstream
/// node that ends as well still sends the message that is being processed and the one queued.
const LATE_MESSAGES: u32 = 4;
/// A message that a step has deferred is discarded after this long.
const DEFERRED_LIMIT_NS: u64 = 1_000_000_000;

/// The time after a node with messages in its queue was asked to end.
struct Drain {
    /// Its start, ns of the machine's clock.
    start_ns: u64,
    /// Number of messages that came after its limit, by topic.
    late: BTreeMap<String, u32>,
}

impl Live<'_> {
    /// Takes the messages that tell what will come, and has the node get ready for it.
    pub(super) fn get_ready(&mut self) -> Result<(), RunError> {
        let begin = self.time.ticks_ns();
        loop {
            let untold = self.node.get_ready();
            let mut is_published = false;
            for topic in &untold {
                let address = Address::resolve(&self.node_name, topic)?;
                is_published |= !self.transport.publishers(&address.topic).is_empty();
            }
            // Publishers of other processes are not known from the start.
            let limit = if is_published { UNTOLD } else { self.transport.settling() };
            let waited = self.time.ticks_ns() - begin;
            if untold.is_empty() || waited >= nanoseconds(limit) || self.stop.urgency() != Urgency::None {
                return Ok(());
            }
            if let Some(arrived) = self.queue.take(Some(GRAPH_GLANCE)) {
                self.handle(arrived)?;
            }
        }
    }

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
                Some(arrived) => {
                    let goes_on = draining && self.upstream_goes_on(&arrived, &mut drain);
                    // Handled in any case: it has left the queue, where it would count as unread.
                    let flow = self.handle(arrived)?;
                    if goes_on || flow == Flow::Done || self.node.period().is_some() {
                        return Ok(());
                    }
                    // Each message restarts both waits, since more may follow it.
                    (quiet_since, alone_since) = (None, None);
                }
                None if draining => {
                    let now = self.time.ticks_ns();
                    // Counted from the first idle moment after a message or after the request to end.
                    let quiet = now - *quiet_since.get_or_insert(now);
                    let mut topics = self.inputs.topics();
                    let alone = topics.all(|topic| self.transport.publishers(topic).is_empty());
                    let alone = alone.then(|| *alone_since.get_or_insert(now));
                    // A message may still be on its way after the token of its publisher has gone.
                    let settled =
                        alone.is_some_and(|since| now - since >= nanoseconds(self.transport.settling()));
                    if settled || quiet > DRAIN_LIMIT_NS {
                        return Ok(());
                    }
                }
                None => self.report_when_due(),
            }
        }
    }

    /// Returns whether a publisher of an input sends as before, although this node was asked to end. `drain` holds the start
    /// of the drain, and the number of messages that came late in it, by topic. Messages queued during a slow step are not late.
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

    pub(super) fn handle_message(&mut self, arrived: Arrived<Incoming>) -> Result<Flow, RunError> {
        let begin = self.time.ticks_ns();
        let (input, read) = self.inputs.of(arrived.lane).expect("a lane is closed together with its input");
        let (declared, address) = (read.topic.clone(), read.address.clone());
        let Some(message) = self.admitted(arrived, &declared, &address, begin) else {
            return Ok(Flow::Continue);
        };
        // The stamp is kept, because the step consumes the message.
        let frame = (message.kind() == MessageKind::Image).then(|| message.stamp());
        self.telemetry.span("decode", begin, self.time.ticks_ns(), frame);
        let passes_on = self.outputs.iter().any(|o| o.address.kind == MessageKind::Image && o.wanted());
        // Before the step: the source can make the next frame while this one is worked on.
        if let Some(stamp) = frame.filter(|_| !passes_on) {
            self.acknowledge(stamp, &[]);
        }
        let trigger = Trigger::Message { input, message };
        let (flow, messages) = self.step(trigger, &address.topic, Some(&declared.name), frame)?;
        if frame.is_some()
            && let Some(end) = self.silence.end(&address.topic, begin, self.time.ticks_ns())
        {
            tracing::info!(node = %self.telemetry.node(), topic = address.topic, "{end}");
        }
        self.send_all(&messages);
        if flow == Flow::NewInputs {
            self.subscribe()?;
        }
        if let (Flow::Deferred, Some(stamp)) = (flow, frame) {
            self.deferred = Some((stamp, address.topic, begin));
        } else if !messages.is_empty() {
            self.deferred = None;
        }
        // A frame that is deferred has no result yet; the step that answers it acknowledges it.
        if passes_on && flow != Flow::Deferred {
            let answered = images(&messages, &self.outputs).or(frame.map(|stamp| (stamp, Vec::new())));
            answered.into_iter().for_each(|(stamp, topics)| self.acknowledge(stamp, &topics));
        }
        Ok(flow)
    }

    /// Returns the message that has arrived if it can be read and is to be answered.
    fn admitted(
        &mut self,
        Arrived { lane, stamp_ns, item }: Arrived<Incoming>,
        declared: &Topic,
        Address { topic, kind, .. }: &Address,
        begin: u64,
    ) -> Option<Message> {
        if let Some(sent) = item.attachment()
            && let Some(warning) = self.delays.note(topic, sent.stamp_ns, stamp_ns)
        {
            tracing::warn!(node = %self.telemetry.node(), topic, "{warning}");
        }
        let opened = item.open(*kind);
        let now = self.time.ticks_ns();
        match opened.and_then(|message| decompressed(declared, message)) {
            Ok(message) => {
                let report = &mut self.telemetry.report;
                self.inputs.admit(lane, message.stamp(), now, report).then_some(message)
            }
            Err(why) => {
                self.skip(topic, &why);
                // Its publisher is not silent.
                self.silence.end(topic, begin, self.time.ticks_ns());
                None
            }
        }
    }

    /// Discards the deferred frame when it has waited long enough, so that a source of rate 0 goes on.
    pub(super) fn discard_deferred(&mut self) {
        let now = self.time.ticks_ns();
        let is_over = |(_, _, since): &mut (_, _, u64)| now.saturating_sub(*since) >= DEFERRED_LIMIT_NS;
        let Some((stamp, topic, _)) = self.deferred.take_if(is_over) else { return };
        if let Some(why) = self.node.give_up() {
            self.skip(&topic, &why);
            self.acknowledge(stamp, &[]);
        }
    }

    /// Acknowledges the frame of `stamp`, from which images on `topics` were made, to sources of rate 0 that listen.
    fn acknowledge(&self, stamp: Time, topics: &[String]) {
        if !self.acks.wanted() {
            return;
        }
        let own = self.transport.id_of(&self.node_name);
        if let Err(why) = self.acks.put(&ack_message(own, stamp, topics)) {
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
