//! The live driver: one node on a transport, until its source is over or
//! somebody says stop. The newest frame wins; each replaced one is counted.

mod inputs;

use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::{RunError, addresses, facts_of, wait_for};
use crate::clock::Clock;
use crate::diagnostics::Diagnostics;
use crate::inbox::Taken;
use crate::message::Message;
use crate::name::Place;
use crate::node::{Context, Cue, Flow, Node, StepError, Yield};
use crate::node_time::NodeTime;
use crate::parameter::events::ParameterEvents;
use crate::parameter::saved::SavedParameters;
use crate::parameter::{Parameters, Refusal};
use crate::report::{NodeReport, add};
use crate::stop::{Stop, Urgency};
use crate::transport::{
    Address, Guard, Outlet, ParameterPort, ParameterRequest, Parcel, Transport, TransportError,
};
use inputs::Inputs;

/// How long the loop sleeps at most before it looks at its flags.
const GLANCE: Duration = Duration::from_millis(20);
/// A draining node gives up this long after its last message, even if its
/// upstream is still there.
const DRAIN_LIMIT_NS: u64 = 2_000_000_000;

/// Who is to be run.
pub struct Subject {
    /// The step.
    pub node: Box<dyn Node>,
    /// Its parameters.
    pub parameters: Parameters,
    /// Its name and remaps.
    pub place: Place,
    /// Where accepted changes of its parameters outlast a crash.
    pub saved: Option<SavedParameters>,
}

/// A node with everything it needs to run.
struct Live<'a> {
    node: Box<dyn Node>,
    place: Place,
    parameters: Arc<Mutex<Parameters>>,
    saved: Option<SavedParameters>,
    transport: &'a dyn Transport,
    time: NodeTime<'a>,
    stop: Stop,
    report: NodeReport,
    outlets: Vec<(Address, Box<dyn Outlet>)>,
    inputs: Inputs,
    diagnostics: Diagnostics,
    parameter_events: ParameterEvents,
}

/// Runs a node until it is done; returns what it did.
///
/// # Errors
/// [`RunError`] when a name, the transport or the step itself fails.
pub fn run(
    subject: Subject,
    transport: &dyn Transport,
    clock: &dyn Clock,
    stop: Stop,
) -> Result<NodeReport, RunError> {
    let Subject { node, parameters, place, saved } = subject;
    let outputs = addresses(&place, &node.outputs())?;
    let outlets = outputs
        .into_iter()
        .map(|address| transport.advertise(&place, &address).map(|outlet| (address, outlet)))
        .collect::<Result<_, _>>()?;
    let diagnostics = Diagnostics::new(&place, transport)?;
    let parameter_events = ParameterEvents::new(&place, transport)?;
    let live = Live {
        report: NodeReport::new(place.fully_qualified()),
        node,
        place,
        parameters: Arc::new(Mutex::new(parameters)),
        saved,
        transport,
        time: NodeTime::new(clock),
        stop,
        outlets,
        inputs: Inputs::none(),
        diagnostics,
        parameter_events,
    };
    live.run()
}

impl Live<'_> {
    fn run(mut self) -> Result<NodeReport, RunError> {
        self.wait_for_others()?;
        self.subscribe()?;
        self.time.follow(&self.settings(), &self.place, self.transport)?;
        let requests = self.serve_parameters()?;
        let announced = self.transport.announce(&self.place)?;
        self.parameter_events.started(self.time.now_ns(), &self.settings());
        tracing::info!(node = %self.report.node, "ready");
        let ended = match self.node.period() {
            Some(_) => self.run_source(&requests.1),
            None => self.run_listener(&requests.1),
        };
        // Out of the graph before the outlets go, so that nobody waits for us.
        drop((announced, requests.0));
        std::mem::replace(&mut self.inputs, Inputs::none()).account(&mut self.report);
        self.report.facts.extend(facts_of(&*self.node));
        ended.map(|()| self.report)
    }

    fn wait_for_others(&self) -> Result<(), RunError> {
        let (mut missing, patience) = wait_for(&self.place, &self.settings())?;
        let start = self.time.ticks_ns();
        loop {
            missing.retain(|node| !self.transport.is_ready(node));
            if missing.is_empty() || self.stop.urgency() != Urgency::None {
                return Ok(());
            }
            if self.time.ticks_ns().saturating_sub(start) > nanoseconds(patience) {
                let (node, seconds) = (self.report.node.clone(), patience.as_secs());
                return Err(RunError::Waited { node, seconds, missing: missing.join(", ") });
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    fn subscribe(&mut self) -> Result<(), RunError> {
        let addresses = addresses(&self.place, &self.node.inputs())?;
        if addresses == self.inputs.addresses {
            return Ok(());
        }
        let renewed = Inputs::subscribe(addresses, &self.place, self.transport)?;
        std::mem::replace(&mut self.inputs, renewed).account(&mut self.report);
        Ok(())
    }

    fn serve_parameters(&self) -> Result<(Guard, Receiver<ParameterRequest>), TransportError> {
        let (sender, receiver) = channel();
        let parameters = self.parameters.clone();
        let read = move || parameters.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let port = ParameterPort { read: Box::new(read), requests: sender };
        Ok((self.transport.serve_parameters(&self.place, port)?, receiver))
    }

    fn settings(&self) -> Parameters {
        self.parameters.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Applies what was asked for between two steps.
    fn answer_requests(&mut self, requests: &Receiver<ParameterRequest>) -> Result<(), RunError> {
        while let Ok(request) = requests.try_recv() {
            let answer = self.change(&request);
            if let Err(refusal) = &answer {
                tracing::warn!(node = %self.report.node, "{refusal}");
            }
            self.subscribe()?;
            self.time.follow(&self.settings(), &self.place, self.transport)?;
            // Nobody may be waiting for the answer any more.
            let _ = request.answer.send(answer);
        }
        Ok(())
    }

    fn change(&mut self, request: &ParameterRequest) -> Result<(), Refusal> {
        let before = self.settings();
        let next = before.with(&request.changes, true)?;
        self.node.configure(&next)?;
        self.parameter_events.changed(self.time.now_ns(), &before, &next);
        if let Some(saved) = &self.saved {
            saved.keep(&next);
        }
        *self.parameters.lock().unwrap_or_else(PoisonError::into_inner) = next;
        Ok(())
    }

    fn run_source(&mut self, requests: &Receiver<ParameterRequest>) -> Result<(), RunError> {
        // Whoever watches the graph, as a recorder does, has subscribed by then.
        let mut due = self.time.ticks_ns() + nanoseconds(self.transport.settling());
        while self.stop.urgency() == Urgency::None {
            self.answer_requests(requests)?;
            let now = self.time.ticks_ns();
            if now < due {
                std::thread::sleep(GLANCE.min(Duration::from_nanos(due - now)));
                continue;
            }
            if self.step(Cue::Tick, None)? == Flow::Done {
                break;
            }
            let period = nanoseconds(self.node.period().unwrap_or_default());
            // A source that is late goes on from now; it does not catch up in a burst.
            due = (due + period).max(self.time.ticks_ns().saturating_sub(period));
        }
        Ok(())
    }

    fn run_listener(&mut self, requests: &Receiver<ParameterRequest>) -> Result<(), RunError> {
        let mut last_work = self.time.ticks_ns();
        loop {
            self.answer_requests(requests)?;
            let inbox = self.inputs.inbox.clone();
            match inbox.take(GLANCE) {
                Taken::Item(slot, parcel) => {
                    if self.handle(slot, parcel)? == Flow::Done {
                        return Ok(());
                    }
                    last_work = self.time.ticks_ns();
                }
                Taken::Nothing => {
                    let idle = self.time.ticks_ns().saturating_sub(last_work);
                    self.diagnostics.publish_when_due(&self.time, &self.report, &*self.node);
                    if self.stop.urgency() == Urgency::Drain && self.is_drained(idle) {
                        return Ok(());
                    }
                }
            }
            if self.stop.urgency() == Urgency::Now {
                return Ok(());
            }
        }
    }

    /// Nothing waits, and nothing more can come.
    fn is_drained(&self, idle_ns: u64) -> bool {
        let upstream = self.inputs.addresses.iter().any(|a| self.transport.has_publisher(&a.topic));
        idle_ns > DRAIN_LIMIT_NS || (!upstream && idle_ns >= nanoseconds(self.transport.settling()))
    }

    fn handle(&mut self, slot: usize, parcel: Parcel) -> Result<Flow, RunError> {
        let Some(address) = self.inputs.addresses.get(slot).cloned() else { return Ok(Flow::Continue) };
        match parcel.open(address.kind) {
            Ok(message) => self.step(Cue::Message { input: slot, message }, Some(&address.topic)),
            Err(why) => {
                self.skip(&address.topic, &why.to_string());
                Ok(Flow::Continue)
            }
        }
    }

    fn step(&mut self, cue: Cue, topic: Option<&str>) -> Result<Flow, RunError> {
        let wanted: Vec<bool> = self.outlets.iter().map(|(_, outlet)| outlet.wanted()).collect();
        let mut cx = Context::new(&self.time, &wanted);
        let result = self.node.step(cue, &mut cx);
        let Yield { messages, stages } = cx.finish();
        for (stage, duration) in stages {
            self.report.book_stage(stage, duration);
        }
        for (output, message) in messages {
            self.send(output, &message);
        }
        self.diagnostics.publish_when_due(&self.time, &self.report, &*self.node);
        match result {
            Ok(flow) => Ok(flow),
            Err(StepError::Skip(why)) => {
                self.skip(topic.unwrap_or("source"), &why);
                Ok(Flow::Continue)
            }
            Err(StepError::Fatal(why)) => Err(RunError::Fatal { node: self.report.node.clone(), why }),
        }
    }

    fn send(&mut self, output: usize, message: &Message) {
        let Some((address, outlet)) = self.outlets.get(output) else { return };
        match outlet.put(message) {
            Ok(()) => self.report.book_published(&address.topic, message),
            Err(why) => {
                tracing::warn!(node = %self.report.node, "{why}");
                add(&mut self.report.dropped, &address.topic, 1);
            }
        }
    }

    fn skip(&mut self, topic: &str, why: &str) {
        tracing::warn!(node = %self.report.node, topic, "skipped: {why}");
        add(&mut self.report.bad, topic, 1);
    }
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}
