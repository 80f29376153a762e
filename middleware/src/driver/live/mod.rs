//! The live driver: one node on a transport, until its source is over or it is asked to stop. The newest frame wins,
//! and each replaced one is counted; only a source of rate 0 waits for its readers (`driver/pacing.rs`).

mod inputs;
mod outputs;
mod requests;
mod source;
mod swap;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use modulo_msgs::std_msgs::Time;
use modulo_runtime::clock::nanos as nanoseconds;
use modulo_runtime::node::status_of;
use modulo_runtime::report::add;
use modulo_runtime::topic::{self, addresses};
use modulo_runtime::trace::{FlowPoint, Span, TraceFile};
use modulo_runtime::wire::attachment::{Attachment, Delays};
use modulo_runtime::{
    Address, Clock, Context, Flow, Message, MessageKind, Node, NodeName, NodeReport, ParameterError,
    Parameters, Part, StepError, StepOutput, Stop, Topic, Trigger, Urgency,
};

use super::{CommonParameters, GRAPH_GLANCE, ImageTransport, RunError, wait_for, wait_until_ready};
use crate::driver::pacing::{Pacing, taken_message, taken_topic};
use crate::graph::diagnostics::{Diagnostics, NodeCondition, StateTopic};
use crate::graph::node_time::NodeTime;
use crate::parameter::events::ParameterEvents;
use crate::process::node_files::{ReportFile, SavedState, WriteReason};
use crate::transport::queue::{Arrived, Lane, Limit, Next, Queue, Queued};
use crate::transport::{Incoming, ParameterRequest, Publisher, Transport};
use inputs::{Inputs, Renewal, Silence, SkipWarnings};
use outputs::{LiveOutput, compressed, decompress};
use requests::{EnableRequest, Making};
use source::images;

/// An idle node wakes this often for its periodic tasks.
const IDLE: Duration = Duration::from_millis(250);
/// A draining node gives up this long after its last message, even if its upstream is still there.
const DRAIN_LIMIT_NS: u64 = 2_000_000_000;
/// After this many late messages on one topic the upstream node is considered to be running on, and the drain ends. An upstream
/// node that ends as well still sends the message that it works on and the one that waits for it.
const LATE_MESSAGES: u32 = 4;
/// A message that a step has kept is given up after this long.
const KEPT_LIMIT_NS: u64 = 1_000_000_000;
/// Parameter requests that wait for a busy node; each caller waits for its answer.
const REQUESTS: usize = 64;

/// The node that is to be run.
pub struct NodeSetup {
    /// The node.
    pub node: Box<dyn Node>,
    /// Parameters of the node.
    pub parameters: Parameters,
    /// Its name and remaps.
    pub node_name: NodeName,
    /// File that keeps the parameters and the position of the node over a crash.
    pub saved: Option<SavedState>,
    /// File that keeps the report of the node over a crash.
    pub report_file: Option<ReportFile>,
}

/// Something that the node's loop has to deal with.
enum LiveEvent {
    /// A message on one of the inputs.
    Message(Incoming),
    /// A request to change parameters.
    Request(ParameterRequest),
    /// A reader has taken a frame of this source.
    Taken(Incoming),
    /// The part that a request needs was made, or cannot be.
    Made(Result<Part, ParameterError>),
    /// A request to pause, or to go on.
    Enable(EnableRequest),
}

impl Queued for LiveEvent {
    fn bytes(&self) -> usize {
        match self {
            Self::Message(incoming) | Self::Taken(incoming) => incoming.bytes(),
            Self::Request(_) | Self::Made(_) | Self::Enable(_) => 0,
        }
    }

    fn attachment(&self) -> Option<&Attachment> {
        match self {
            Self::Message(incoming) | Self::Taken(incoming) => incoming.attachment(),
            Self::Request(_) | Self::Made(_) | Self::Enable(_) => None,
        }
    }
}

type EventQueue = Queue<LiveEvent>;

/// The time after a node with messages in its queue was asked to end.
struct Drain {
    /// Its start, ns of the machine's clock.
    start_ns: u64,
    /// Number of messages that came after its limit, by topic.
    late: BTreeMap<String, u32>,
}

/// A node with everything it needs to run.
struct Live<'a> {
    node: Box<dyn Node>,
    node_name: NodeName,
    parameters: Arc<Mutex<Parameters>>,
    saved: Option<SavedState>,
    report_file: Option<ReportFile>,
    transport: &'a dyn Transport,
    time: NodeTime<'a>,
    stop: Stop,
    queue: Arc<EventQueue>,
    report: NodeReport,
    outputs: Vec<LiveOutput>,
    inputs: Inputs,
    /// Tells sources of rate 0 which frames this node has taken.
    taken: Box<dyn Publisher>,
    /// The readers of this node's own frames, if it is such a source.
    pacing: Pacing,
    diagnostics: Diagnostics,
    state: StateTopic,
    /// The part that a request waits for.
    making: Option<Making>,
    /// Number of changes of parameters so far.
    changes: u64,
    /// The warnings about messages that could not be read.
    warnings: SkipWarnings,
    /// The delays of messages between machines.
    delays: Delays,
    parameter_events: ParameterEvents,
    /// The wait for the next image.
    silence: Silence,
    /// The frame that the last step on an image has kept: its stamp, its topic, and the ticks since then.
    kept: Option<(Time, String, u64)>,
    /// The spans of this run, if its launcher wants them.
    trace: Option<TraceFile>,
    /// Whether the node works. While it does not, it has no subscription, and a source sends nothing.
    enabled: bool,
}

/// Runs a node until it is done, and returns its report.
///
/// # Errors
/// [`RunError`] when a name, the transport or the step itself fails.
pub fn run(
    setup: NodeSetup,
    transport: &dyn Transport,
    clock: &Arc<dyn Clock>,
    stop: Stop,
) -> Result<NodeReport, RunError> {
    let NodeSetup { node, parameters, node_name, saved, report_file } = setup;
    // Publishers come before subscriptions: the first message may already cause an output.
    let outputs = node.outputs();
    let outputs =
        outputs.iter().map(|topic| LiveOutput::advertise(topic, &node_name, &parameters, transport));
    let outputs = outputs.collect::<Result<Vec<_>, _>>()?;
    let diagnostics = Address::resolve(&node_name, &topic::diagnostics())?;
    let diagnostics = match outputs.iter().find(|output| output.address.topic == diagnostics.topic) {
        Some(output) => output.publisher.clone(),
        None => transport.advertise(&node_name, &diagnostics)?.into(),
    };
    let queue = Arc::new(Queue::new(clock.clone(), Limit { messages: REQUESTS, bytes: usize::MAX }));
    // A node that waits for a message must see a request to end at once.
    stop.wakes(&queue);
    let state = transport.advertise(&node_name, &Address::resolve(&node_name, &StateTopic::topic())?)?;
    let live = Live {
        report: NodeReport::new(node_name.fully_qualified()),
        node,
        parameters: Arc::new(Mutex::new(parameters)),
        saved,
        report_file,
        transport,
        time: NodeTime::new(&**clock),
        stop,
        inputs: Inputs::new(queue.clone()),
        queue,
        outputs,
        taken: transport.advertise(&node_name, &Address::resolve(&node_name, &taken_topic())?)?,
        pacing: Pacing::default(),
        diagnostics: Diagnostics::new(diagnostics),
        state: StateTopic::new(state),
        making: None,
        changes: 0,
        warnings: SkipWarnings::default(),
        delays: Delays::default(),
        parameter_events: ParameterEvents::new(&node_name, transport)?,
        silence: Silence::default(),
        kept: None,
        trace: TraceFile::of_launch(&node_name.fully_qualified(), &**clock),
        enabled: true,
        node_name,
    };
    live.run()
}

impl Live<'_> {
    fn run(mut self) -> Result<NodeReport, RunError> {
        if let Some(position) = self.saved.as_ref().and_then(SavedState::position) {
            tracing::info!(node = %self.report.node, "goes on behind frame {position}, as before the crash");
            self.node.resume(position);
        }
        self.wait_for_others()?;
        self.subscribe()?;
        let clock = self.time.open(&self.settings(), &self.node_name, self.transport)?;
        self.time.follow(clock);
        let served = (self.serve_parameters()?, self.serve_enable()?);
        // Last of all: a node that waits for this one may send at once.
        let announced = self.transport.announce(&self.node_name)?;
        self.parameter_events.started(self.time.now_ns(), &self.settings());
        self.tell_state(Time::from_ns(self.time.now_ns()));
        self.keep_account(WriteReason::Edge);
        tracing::info!(node = %self.report.node, "ready");
        // Another source may make a source a listener, and the other way round.
        let ended = loop {
            let is_source = self.node.period().is_some();
            let ended = if is_source { self.run_source() } else { self.run_listener() };
            let goes_on = self.stop.urgency() == Urgency::None && self.node.period().is_some() != is_source;
            if ended.is_err() || !goes_on {
                break ended;
            }
        };
        if ended.is_ok() && self.stop.urgency() == Urgency::None {
            self.state.tell_end(Time::from_ns(self.time.now_ns()), &self.report.node);
        }
        // Out of the graph before the publishers go, so that no other node waits for this one.
        drop((announced, served));
        self.close(ended)
    }

    /// Ends the subscriptions and completes the report of a node that has ended.
    fn close(mut self, ended: Result<(), RunError>) -> Result<NodeReport, RunError> {
        // From here on requests are refused, so that no caller waits for a node that has ended.
        self.queue.end();
        self.making.take().into_iter().for_each(Making::join);
        self.inputs.close(&mut self.report);
        for (topic, said) in self.warnings.rest() {
            tracing::warn!(node = %self.report.node, topic, "{said}");
        }
        self.report.status.extend(status_of(&*self.node));
        // The report of a node that failed stays one of a node that crashed, whose frames are missing.
        self.report.running = ended.is_err();
        if let Some(file) = &mut self.report_file {
            file.write(&self.report, self.time.ticks_ns());
        }
        ended.map(|()| self.report)
    }

    /// Brings the account on the disk up to date when that is due.
    fn keep_account(&mut self, reason: WriteReason) {
        let now = self.time.ticks_ns();
        let Some(file) = self.report_file.as_mut().filter(|file| file.is_due(reason, now)) else { return };
        // A copy: the counts of open subscriptions go into the file, and into the report only when they are closed.
        let mut report = NodeReport { running: true, ..self.report.clone() };
        self.inputs.count(&mut report);
        report.status.extend(status_of(&*self.node));
        file.write(&report, now);
    }

    fn wait_for_others(&self) -> Result<(), RunError> {
        let (nodes, patience) = wait_for(&self.node_name, &self.settings())?;
        wait_until_ready(self.transport, &self.time, nodes, patience, &self.stop).map_err(|missing| {
            RunError::Waited { node: self.report.node.clone(), seconds: patience.as_secs(), missing }
        })
    }

    /// Subscribes to the inputs that the node has now.
    fn subscribe(&mut self) -> Result<(), RunError> {
        let topics = self.node.inputs();
        let renewal = self.open_inputs(topics, &self.settings())?;
        self.renew_inputs(renewal);
        Ok(())
    }

    /// Opens the subscriptions to `topics` that the node needs in addition, with the driver's own `parameters`.
    fn open_inputs(&self, topics: Vec<Topic>, parameters: &Parameters) -> Result<Renewal, RunError> {
        let topics = self.without_own_camera_info(topics)?;
        let addresses = self.input_addresses(&topics, parameters)?;
        Ok(self.inputs.open(topics.into_iter().zip(addresses).collect(), &self.node_name, self.transport)?)
    }

    /// Returns the addresses of `topics`, which the node may read with the driver's own `parameters`.
    fn input_addresses(&self, topics: &[Topic], parameters: &Parameters) -> Result<Vec<Address>, RunError> {
        let mut addresses = addresses(&self.node_name, topics)?;
        let CommonParameters { image_transport, .. } = parameters.into();
        if image_transport == ImageTransport::Compressed {
            for image in addresses.iter_mut().filter(|address| address.kind == MessageKind::Image) {
                *image = compressed(image);
            }
        }
        match addresses.iter().find(|input| self.outputs.iter().any(|output| output.publishes(&input.topic)))
        {
            Some(Address { topic, .. }) => Err(RunError::OwnOutput(topic.clone())),
            None => Ok(addresses),
        }
    }

    /// Goes over to the inputs of `renewal`. A node that is paused has none.
    fn renew_inputs(&mut self, renewal: Renewal) {
        if self.enabled {
            self.inputs.renew(renewal, self.time.ticks_ns(), &mut self.report);
        } else {
            self.inputs.cancel(renewal);
        }
    }

    /// Leaves out a camera info that this node publishes itself. It belongs to an image by convention, nobody has chosen it.
    fn without_own_camera_info(&self, mut topics: Vec<Topic>) -> Result<Vec<Topic>, RunError> {
        let addresses = addresses(&self.node_name, &topics)?;
        let is_own = |input: &Address| {
            input.kind == MessageKind::CameraInfo
                && self.outputs.iter().any(|o| o.address.topic == input.topic)
        };
        let mut addresses = addresses.iter();
        topics.retain(|_| addresses.next().is_none_or(|address| !is_own(address)));
        Ok(topics)
    }

    fn run_listener(&mut self) -> Result<(), RunError> {
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

    fn handle(&mut self, arrived: Arrived<LiveEvent>) -> Result<Flow, RunError> {
        match arrived.item {
            LiveEvent::Message(incoming) => self.handle_message(arrived.lane, arrived.stamp_ns, incoming),
            LiveEvent::Request(request) => self.answer(request).map(|()| Flow::Continue),
            LiveEvent::Made(part) => self.made(part).map(|()| Flow::Continue),
            LiveEvent::Enable(request) => self.enable(&request).map(|()| Flow::Continue),
            LiveEvent::Taken(incoming) => {
                if let Ok(Message::Diagnostics(taken)) = incoming.open(MessageKind::Diagnostics) {
                    self.pacing.note(&taken);
                }
                Ok(Flow::Continue)
            }
        }
    }

    fn handle_message(&mut self, lane: Lane, arrived_ns: u64, incoming: Incoming) -> Result<Flow, RunError> {
        let (input, read) = self.inputs.of(lane).expect("a lane is closed together with its input");
        let (declared, Address { topic, kind, .. }) = (read.topic.clone(), read.address.clone());
        self.watch_delay(&topic, incoming.attachment(), arrived_ns);
        let begin = self.time.ticks_ns();
        let opened = incoming.open(kind).map_err(|why| why.to_string());
        let message = match opened.and_then(|message| decompressed(&declared, message)) {
            Ok(message) => message,
            Err(why) => {
                self.skip(&topic, &why);
                // It cannot be read, but its publisher is not silent.
                self.silence.end(&topic, begin, self.time.ticks_ns());
                return Ok(Flow::Continue);
            }
        };
        if !self.inputs.admit(lane, message.stamp(), self.time.ticks_ns(), &mut self.report) {
            return Ok(Flow::Continue);
        }
        // The stamp is kept, because the step consumes the message.
        let frame = (message.kind() == MessageKind::Image).then(|| message.stamp());
        self.trace("decode", begin, frame);
        let told = frame.filter(|_| self.taken.wanted());
        let passes_on = self.outputs.iter().any(|o| o.address.kind == MessageKind::Image && o.wanted());
        // Before the step: the source can make the next frame while this one is worked on.
        if let Some(stamp) = told.filter(|_| !passes_on) {
            self.tell_taken(stamp, &[]);
        }
        let trigger = Trigger::Message { input, message };
        let (flow, messages) = self.step(trigger, &topic, Some(&declared.name), frame)?;
        if frame.is_some()
            && let Some(said) = self.silence.end(&topic, begin, self.time.ticks_ns())
        {
            tracing::info!(node = %self.report.node, topic, "{said}");
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
    fn give_up_kept(&mut self) {
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

    fn watch_delay(&mut self, topic: &str, attachment: Option<&Attachment>, arrived_ns: u64) {
        let Some(attachment) = attachment else { return };
        if let Some(warning) = self.delays.note(topic, attachment.stamp_ns, arrived_ns) {
            tracing::warn!(node = %self.report.node, topic, "{warning}");
        }
    }

    /// Adds the compressed variants that have readers to the messages of a step. An image whose compressed variant alone has
    /// readers is replaced by it.
    fn with_compressed(&mut self, messages: Vec<(usize, Message)>) -> Vec<(usize, Message)> {
        let mut all = Vec::with_capacity(messages.len());
        for (index, message) in messages {
            let format = || CommonParameters::from(&self.settings()).compressed_format;
            let start = self.time.ticks_ns();
            let Some(output) = self.outputs.get(index) else { continue };
            match output.compress(&message, format) {
                None => all.push((index, message)),
                Some(Ok(file)) => {
                    if output.publisher.wanted() {
                        all.push((index, message));
                    }
                    all.push((index, file));
                    self.report.book_stage("compress", self.time.ticks_ns() - start);
                }
                Some(Err(why)) => {
                    let topic = output.route(MessageKind::CompressedImage).0.to_owned();
                    all.push((index, message));
                    self.skip(&topic, &why);
                }
            }
        }
        all
    }

    fn tell_taken(&self, stamp: Time, topics: &[String]) {
        if let Err(why) = self.taken.put(&taken_message(&self.report.node, stamp, topics)) {
            tracing::warn!(node = %self.report.node, "{why}");
        }
    }

    /// Runs one step; returns the messages that it left. `topic` is named when the step skips its input, which came on
    /// `stream`; a source reads no stream. `frame` is the stamp of an input image.
    fn step(
        &mut self,
        trigger: Trigger,
        topic: &str,
        stream: Option<&str>,
        frame: Option<Time>,
    ) -> Result<(Flow, Vec<(usize, Message)>), RunError> {
        let wanted: Vec<bool> = self.outputs.iter().map(LiveOutput::wanted).collect();
        let mut cx = Context::new(&self.report.node, &self.time, &wanted);
        let begin = self.time.ticks_ns();
        let result = self.node.step(trigger, &mut cx);
        let mut output = cx.finish();
        output.messages = self.with_compressed(output.messages);
        let image = output.messages.iter().find(|(_, message)| message.kind() == MessageKind::Image);
        let made = image.map(|(_, message)| message.stamp());
        let point = match made {
            _ if result == Ok(Flow::Kept) => None,
            Some(_) if stream.is_none() => Some(FlowPoint::Source),
            Some(_) => Some(FlowPoint::Pass),
            None => frame.map(|_| FlowPoint::End),
        };
        if let Some(trace) = &self.trace {
            trace.add_step((begin, self.time.ticks_ns()), &output, frame.or(made), point);
        }
        self.diagnostics.book(&output.stages, frame.or(made.filter(|_| stream.is_none())));
        self.book(&output, stream);
        // Before the messages of the first frame that was made with these values.
        if let Some((_, first)) = output.messages.first() {
            self.tell_state(first.stamp());
        }
        self.settle(result, output.messages, topic, stream.is_none())
    }

    /// Counts and reports the failure of a step; a step that is only skipped goes on.
    fn settle(
        &mut self,
        result: Result<Flow, StepError>,
        messages: Vec<(usize, Message)>,
        topic: &str,
        is_source: bool,
    ) -> Result<(Flow, Vec<(usize, Message)>), RunError> {
        match result {
            Ok(flow) => Ok((flow, messages)),
            // Each frame of a source is told: its name is in the text.
            Err(StepError::Skip(why)) if is_source => {
                tracing::warn!(node = %self.report.node, topic, "skipped: {why}");
                add(&mut self.report.bad, topic, 1);
                Ok((Flow::Continue, messages))
            }
            Err(StepError::Skip(why)) => {
                self.skip(topic, &why);
                Ok((Flow::Continue, messages))
            }
            Err(StepError::Fatal(why)) => {
                if !is_source {
                    add(&mut self.report.bad, topic, 1);
                }
                // They are counted as sent already, and were made before the step failed.
                self.send_all(&messages);
                Err(RunError::Fatal(self.report.node.clone(), why))
            }
        }
    }

    /// Counts the output of a step before it is sent: messages that a crash keeps from being sent are then missed by
    /// their readers.
    fn book(&mut self, output: &StepOutput, stream: Option<&str>) {
        for (stage, duration) in &output.stages {
            self.report.book_stage(stage, *duration);
        }
        for (output, message) in &output.messages {
            if let Some(output) = self.outputs.get(*output) {
                self.report.book_published(output.route(message.kind()).0, message, stream);
            }
        }
        for output in &output.unwanted {
            if let Some(output) = self.outputs.get(*output) {
                add(&mut self.report.unwanted, &output.address.topic, 1);
            }
        }
    }

    /// Brings the accounts on the disk up to date, and then sends `messages`.
    fn send_all(&mut self, messages: &[(usize, Message)]) {
        self.keep_account(if self.node.period().is_some() { WriteReason::Source } else { WriteReason::Step });
        // Before the frame leaves: a crash in between loses it, but never sends it twice.
        if let (Some(saved), Some(position)) = (&self.saved, self.node.position()) {
            saved.keep_position(position);
        }
        let begin = self.time.ticks_ns();
        for (output, message) in messages {
            self.send(*output, message);
        }
        let of_a_frame = |kind| matches!(kind, MessageKind::Image | MessageKind::Detections);
        let mut sent = messages.iter().filter(|(_, message)| of_a_frame(message.kind()));
        self.trace("send", begin, sent.next().map(|(_, message)| message.stamp()));
        self.tell_when_due();
    }

    /// Adds a span from `begin` until now to the trace, if it belongs to a frame.
    fn trace(&self, name: &'static str, begin: u64, frame: Option<Time>) {
        if let (Some(trace), Some(_)) = (&self.trace, frame) {
            trace.add(Span { name, begin, end: self.time.ticks_ns(), frame, flow: None });
        }
    }

    fn send(&mut self, output: usize, message: &Message) {
        let Some(output) = self.outputs.get(output) else { return };
        let (topic, publisher) = output.route(message.kind());
        if let Err(why) = publisher.put(message) {
            tracing::warn!(node = %self.report.node, "{why}");
            add(&mut self.report.bad, topic, 1);
        }
    }

    /// Publishes the values in use from the frame of `stamp` on, if they have changed.
    fn tell_state(&mut self, stamp: Time) {
        let mut of_driver = vec![("enabled", self.enabled.to_string())];
        of_driver.extend(self.inputs.stream().map(|stream| ("stream", stream)));
        of_driver.extend(self.making.as_ref().map(|making| ("loading", making.to_string())));
        self.state.tell(stamp, &self.report.node, &*self.node, of_driver);
    }

    /// Publishes the counts of the node on `/diagnostics` and writes them to its report file, once a second; warns of
    /// streams that do not come.
    fn tell_when_due(&mut self) {
        self.give_up_kept();
        self.keep_account(WriteReason::Idle);
        for warning in self.inputs.look(self.time.ticks_ns(), &mut self.report) {
            tracing::warn!(node = %self.report.node, "{warning}");
        }
        if self.stop.urgency() == Urgency::None {
            let (topics, now) = (self.inputs.image_topics(), self.time.ticks_ns());
            if let Some(said) = self.silence.look(topics, &self.report.node, self.transport, now) {
                tracing::warn!(node = %self.report.node, "{said}");
            }
        }
        if self.diagnostics.is_due(&self.time) {
            let mut report = self.report.clone();
            self.inputs.count(&mut report);
            let condition = match self.silence.told() {
                _ if !self.enabled => NodeCondition::Disabled,
                Some(warning) => NodeCondition::Silent(warning),
                None => NodeCondition::Running,
            };
            self.diagnostics.publish(&self.time, &report, &*self.node, &condition);
        }
    }

    fn skip(&mut self, topic: &str, why: &str) {
        add(&mut self.report.bad, topic, 1);
        if let Some(said) = self.warnings.note(topic, why, self.time.ticks_ns()) {
            tracing::warn!(node = %self.report.node, topic, "{said}");
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
