//! The live driver: one node on a transport, until its source is over or it is asked to stop. The newest frame wins,
//! and each replaced one is counted; only a source of rate 0 waits for its readers (`driver/pacing.rs`).

mod inputs;
mod listener;
mod outputs;
mod requests;
mod settings;
mod source;
mod step;
mod swap;
mod telemetry;
mod watch;

use std::sync::Arc;
use std::time::Duration;

use modulo_msgs::std_msgs::Time;
use modulo_runtime::clock::nanos as nanoseconds;
use modulo_runtime::report::add;
use modulo_runtime::wire::attachment::{Attachment, Delays};
use modulo_runtime::{
    Address, Clock, Flow, Message, MessageKind, Node, NodeName, NodeReport, ParameterError, Parameters, Part,
    RareWarnings, Stop, Topic, Urgency,
};

use super::{CommonParameters, GRAPH_GLANCE, ImageTransport, RunError, wait_until_ready};
use crate::driver::pacing::{Pacing, ack_topic};
use crate::graph::node_time::NodeTime;
use crate::parameter::events::ParameterEvents;
use crate::process::node_files::{IDLE_NS, ReportFile, SavedState};
use crate::transport::queue::{Arrived, Limit, Queue, Queued};
use crate::transport::{Incoming, ParameterRequest, Publisher, Transport};
use inputs::{Inputs, Renewal};
use outputs::{LiveOutput, compressed};
use requests::{EnableRequest, Loading, Work};
use settings::Settings;
use telemetry::Telemetry;
use watch::Silence;

/// An idle node wakes this often for its periodic tasks.
const IDLE: Duration = Duration::from_millis(250);
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

enum LiveEvent {
    /// A message on one of the inputs.
    Message(Incoming),
    /// A request to change parameters.
    Request(ParameterRequest),
    /// A reader has acknowledged a frame of this source.
    Ack(Incoming),
    /// The part that a request needs was loaded, or cannot be.
    Loaded(Result<Part, ParameterError>),
    /// The part that a step has asked for was made, or cannot be.
    Made(Result<Part, ParameterError>),
    /// A request to pause, or to go on.
    Enable(EnableRequest),
}

impl Queued for LiveEvent {
    fn attachment(&self) -> Option<&Attachment> {
        match self {
            Self::Message(incoming) => incoming.attachment(),
            Self::Ack(_) | Self::Request(_) | Self::Loaded(_) | Self::Made(_) | Self::Enable(_) => None,
        }
    }
}

type EventQueue = Queue<LiveEvent>;

struct Live<'a> {
    node: Box<dyn Node>,
    node_name: NodeName,
    settings: Settings,
    transport: &'a dyn Transport,
    time: NodeTime<'a>,
    /// When the publishers were declared, in ticks of the clock.
    advertised_ns: u64,
    stop: Stop,
    queue: Arc<EventQueue>,
    outputs: Vec<LiveOutput>,
    inputs: Inputs<'a>,
    /// Acknowledges frames to sources of rate 0.
    acks: Box<dyn Publisher>,
    /// The readers of this node's own frames, if it is such a source.
    pacing: Pacing,
    telemetry: Telemetry,
    /// By topic.
    skips: RareWarnings,
    /// Of parameters; one source, since a peer may invent names.
    refusals: RareWarnings,
    delays: Delays,
    silence: Silence,
    /// The part that a request waits for.
    loading: Option<Loading>,
    /// The part that a step has asked for.
    made_beside: Option<Work>,
    /// The frame that the last step on an image has deferred: its stamp, its topic, and the ticks since then.
    deferred: Option<(Time, String, u64)>,
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
    let output = |topic: &Topic| LiveOutput::advertise(topic, &node_name, &parameters, transport);
    let outputs = node.outputs().iter().map(output).collect::<Result<Vec<_>, _>>()?;
    let queue = Arc::new(Queue::new(clock.clone(), Limit { messages: REQUESTS, bytes: usize::MAX }));
    // A node that waits for a message must see a request to end at once.
    stop.wakes(&queue);
    let live = Live {
        node,
        settings: Settings::new(parameters, saved, ParameterEvents::new(&node_name, transport)?),
        transport,
        time: NodeTime::new(&**clock),
        advertised_ns: clock.ticks_ns(),
        stop,
        inputs: Inputs::new(transport, queue.clone()),
        queue,
        acks: transport.advertise(&node_name, &Address::resolve(&node_name, &ack_topic())?)?,
        pacing: Pacing::default(),
        skips: RareWarnings::default(),
        refusals: RareWarnings::default(),
        delays: Delays::default(),
        silence: Silence::default(),
        telemetry: Telemetry::open(&node_name, report_file, &outputs, transport, &**clock)?,
        outputs,
        loading: None,
        made_beside: None,
        deferred: None,
        enabled: true,
        node_name,
    };
    live.run()
}

impl Live<'_> {
    fn run(mut self) -> Result<NodeReport, RunError> {
        if let Some(position) = self.settings.position() {
            tracing::info!(node = %self.telemetry.node(), "goes on behind frame {position}, as before the crash");
            self.node.resume(position);
        }
        // Before it waits for others: they get ready for its first frame.
        self.introduce();
        self.wait_for_others()?;
        self.subscribe()?;
        let clock = self.time.open(&self.settings.read(), &self.node_name, self.transport)?;
        self.time.follow(clock);
        self.get_ready()?;
        let served = (self.serve_parameters()?, self.serve_enable()?);
        // Last of all: a node that waits for this one may send at once.
        let announced = self.transport.announce(&self.node_name)?;
        self.settings.started(self.time.now_ns());
        self.publish_state(Time::from_ns(self.time.now_ns()));
        self.write_report(0);
        tracing::info!(node = %self.telemetry.node(), "ready");
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
            let now = Time::from_ns(self.time.now_ns());
            self.telemetry.state.publish_end(now, &self.telemetry.report.node);
        }
        // Out of the graph before the publishers go, so that no other node waits for this one.
        drop((announced, served));
        self.close(ended)
    }

    /// Ends the subscriptions and completes the report of a node that has ended.
    fn close(mut self, ended: Result<(), RunError>) -> Result<NodeReport, RunError> {
        // First, since a message that comes to a queue that has ended is in no count.
        self.inputs.close(true, &mut self.telemetry.report);
        // From here on requests are refused, so that no caller waits for a node that has ended.
        self.queue.end();
        // The process must not end while a library of an engine is at work.
        let works = [self.loading.take().map(|loading| loading.work), self.made_beside.take()];
        works.into_iter().flatten().for_each(|work| drop(work.thread.join()));
        for (topic, warning) in self.skips.rest() {
            tracing::warn!(node = %self.telemetry.node(), topic, "skipped: {warning}");
        }
        for (parameters, warning) in self.refusals.rest() {
            tracing::warn!(node = %self.telemetry.node(), "{parameters}: {warning}");
        }
        let report = self.telemetry.close(&self.outputs, &*self.node, ended.is_err(), self.time.ticks_ns());
        ended.map(|()| report)
    }

    fn wait_for_others(&self) -> Result<(), RunError> {
        let CommonParameters { wait_for, wait_timeout, .. } = (&self.settings.read()).into();
        let nodes = wait_for.iter().map(|name| self.node_name.resolve(name)).collect::<Result<_, _>>()?;
        let patience = Duration::from_secs_f64(wait_timeout);
        wait_until_ready(self.transport, &self.time, nodes, patience, &self.stop).map_err(|missing| {
            let seconds = patience.as_secs();
            let why =
                format!("waited {seconds} s for {missing}, which is not there; start it, or change wait_for");
            RunError::Fatal(self.telemetry.node().to_owned(), why)
        })
    }

    fn subscribe(&mut self) -> Result<(), RunError> {
        let topics = self.node.inputs();
        let renewal = self.open_inputs(topics, &self.settings.read())?;
        self.renew_inputs(renewal);
        Ok(())
    }

    /// Opens the subscriptions to `topics` that the node needs in addition, with the driver's own `parameters`.
    fn open_inputs(&self, topics: Vec<Topic>, parameters: &Parameters) -> Result<Renewal, RunError> {
        let inputs = self.input_addresses(topics, parameters)?;
        Ok(self.inputs.open(inputs, &self.node_name)?)
    }

    /// Returns those of `topics` that the node may read with the driver's own `parameters`, with their addresses. A camera info
    /// that this node publishes itself is left out: it belongs to an image by convention, nobody has chosen it.
    fn input_addresses(
        &self,
        topics: Vec<Topic>,
        parameters: &Parameters,
    ) -> Result<Vec<(Topic, Address)>, RunError> {
        let CommonParameters { image_transport, .. } = parameters.into();
        let mut inputs = Vec::new();
        for topic in topics {
            let mut address = Address::resolve(&self.node_name, &topic)?;
            if image_transport == ImageTransport::Compressed && address.kind == MessageKind::Image {
                address = compressed(&address);
            }
            let is_own = self.outputs.iter().any(|output| output.publishes(&address.topic));
            if !is_own {
                inputs.push((topic, address));
            } else if topic.kind != MessageKind::CameraInfo {
                return Err(RunError::OwnOutput(address.topic));
            }
        }
        Ok(inputs)
    }

    /// Replaces the subscriptions by those of `renewal`. A node that is paused has none.
    fn renew_inputs(&mut self, renewal: Renewal) {
        if self.enabled {
            self.inputs.renew(renewal, self.time.ticks_ns(), &mut self.telemetry.report);
        }
    }

    fn handle(&mut self, arrived: Arrived<LiveEvent>) -> Result<Flow, RunError> {
        let Arrived { lane, stamp_ns, item } = arrived;
        match item {
            LiveEvent::Message(item) => self.handle_message(Arrived { lane, stamp_ns, item }),
            LiveEvent::Request(request) => self.answer(request).map(|()| Flow::Continue),
            LiveEvent::Loaded(part) => self.loaded(part).map(|()| Flow::Continue),
            LiveEvent::Made(part) => {
                self.made(part);
                Ok(Flow::Continue)
            }
            LiveEvent::Enable(request) => self.enable(&request).map(|()| Flow::Continue),
            LiveEvent::Ack(incoming) => {
                if let Ok(Message::Diagnostics(ack)) = incoming.open(MessageKind::Diagnostics) {
                    self.pacing.note(&ack);
                }
                Ok(Flow::Continue)
            }
        }
    }

    /// Publishes the values in use from the frame of `stamp` on, if they have changed.
    fn publish_state(&mut self, stamp: Time) {
        let mut of_driver = vec![("enabled", self.enabled.to_string())];
        of_driver.extend(self.inputs.stream().map(|stream| ("stream", stream)));
        of_driver.extend(self.loading.as_ref().map(|loading| ("loading", loading.to_string())));
        let Telemetry { state, report, .. } = &mut self.telemetry;
        state.publish(stamp, &report.node, &*self.node, of_driver);
    }

    /// Brings the report on the disk up to date when it is older than `pause_ns`.
    fn write_report(&mut self, pause_ns: u64) {
        self.telemetry.write_report(pause_ns, (&self.inputs, &self.outputs), &*self.node, &self.time);
    }

    /// Does what is due beside the frames: discards a deferred frame, updates the report and `/diagnostics`, and warns.
    fn report_when_due(&mut self) {
        self.discard_deferred();
        self.write_report(IDLE_NS);
        for warning in self.inputs.look(self.time.ticks_ns(), &mut self.telemetry.report) {
            tracing::warn!(node = %self.telemetry.node(), "{warning}");
        }
        if self.stop.urgency() == Urgency::None {
            let (topics, now) = (self.inputs.image_topics(), self.time.ticks_ns());
            if let Some(warning) = self.silence.look(topics, self.telemetry.node(), self.transport, now) {
                tracing::warn!(node = %self.telemetry.node(), "{warning}");
            }
        }
        let condition = (self.enabled, self.silence.warning());
        self.telemetry.publish(&self.inputs, &*self.node, condition, &self.time);
    }

    /// Counts a message of `topic` that is skipped.
    fn skip(&mut self, topic: &str, why: &str) {
        add(&mut self.telemetry.report.bad, topic, 1);
        if let Some(warning) = self.skips.note(topic, why, self.time.ticks_ns()) {
            tracing::warn!(node = %self.telemetry.node(), topic, "skipped: {warning}");
        }
    }
}
