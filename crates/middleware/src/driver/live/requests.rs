//! Requests to change the parameters of a live node: applied between two steps, all changes of a request at once. A part
//! that takes long to make, such as a model, is made on a thread of its own first, while the node goes on as before.
//!
//! Each change takes effect whole or not at all. In this order it is checked, its part is made, its inputs are subscribed,
//! the node takes it, and only then is it stored, saved and published.

use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use modulo_msgs::std_msgs::Time;
use modulo_runtime::{Clock, Job, ParameterError, Parameters, Part, PlannedInputs, Value};

use super::{Live, LiveEvent};
use crate::driver::RunError;
use crate::transport::queue::{Keep, Lane};
use crate::transport::{Claim, Guard, ParameterAnswer, ParameterPort, ParameterRequest, TransportError};

/// A request to pause a node, or to let it go on.
pub(super) struct EnableRequest {
    enabled: bool,
    answer: Sender<()>,
    /// Decides between the node that applies the request and the caller that gives up.
    claim: Claim,
}

/// Time that a caller of `~/enable` waits for the end of the step at hand.
const PATIENCE: Duration = Duration::from_secs(10);

const PANICKED: &str = "the program failed at it; see the log";

/// A request whose changes are looked at, one after the other.
struct PreparedRequest {
    request: ParameterRequest,
    /// The parameters after the changes so far, if each one is accepted that was not refused.
    expected: Parameters,
    /// For each change so far: the part that it needs, or the reason why it is refused.
    parts: Vec<Result<Option<Part>, ParameterError>>,
    /// Whether the caller knows that its request takes effect, however long that takes.
    promised: bool,
}

impl PreparedRequest {
    /// Tells the caller that its request takes effect when all is loaded. Returns whether the caller knows it.
    fn promise(&mut self) -> bool {
        if !self.promised && self.request.claim.take() {
            self.promised = true;
            // Fails only when the caller has gone.
            let _ = self.request.answer.send(ParameterAnswer::Loading);
        }
        self.promised
    }
}

/// A part that is being loaded.
pub(super) struct Loading {
    prepared: PreparedRequest,
    /// The parameters that the part is for.
    next: Parameters,
    pub work: Work,
}

/// A job on a thread of its own, whose end comes as an event.
pub(super) struct Work {
    lane: Lane,
    pub thread: JoinHandle<()>,
}

/// The names and the values that are being loaded.
impl fmt::Display for Loading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (names, values) = difference(&self.prepared.expected, &self.next);
        write!(f, "{names} = {values}")
    }
}

/// Returns the refusal of the change from `now` to `next`.
fn refusal(now: &Parameters, next: &Parameters, why: &str) -> ParameterError {
    let (names, values) = difference(now, next);
    ParameterError::new(names, values, why)
}

/// Returns the names and the values that differ between two sets.
fn difference(now: &Parameters, next: &Parameters) -> (String, String) {
    let (names, values): (Vec<_>, Vec<_>) =
        now.changed(next).map(|(name, value)| (name, value.to_string())).unzip();
    (names.join(", "), values.join(", "))
}

impl Live<'_> {
    /// Offers the parameters to the graph. A request waits in the queue of the node for the end of a step.
    pub(super) fn serve_parameters(&self) -> Result<Guard, TransportError> {
        let (queue, lane) = (self.queue.clone(), self.queue.open(Keep::All));
        let request = move |request| queue.push(lane, LiveEvent::Request(request)).is_none();
        let port = ParameterPort { read: Box::new(self.settings.reader()), request: Box::new(request) };
        self.transport.serve_parameters(&self.node_name, port)
    }

    pub(super) fn serve_enable(&self) -> Result<Guard, TransportError> {
        let (queue, lane) = (self.queue.clone(), self.queue.open(Keep::All));
        let enable = move |enabled| {
            let (answer, answered) = channel();
            let claim = Claim::default();
            let request = EnableRequest { enabled, answer, claim: claim.clone() };
            if queue.push(lane, LiveEvent::Enable(request)).is_some() {
                return Err("the node is busy with other requests, or is ending".to_owned());
            }
            // The node may apply it just now.
            if answered.recv_timeout(PATIENCE).is_ok() || !claim.take() {
                return Ok(());
            }
            Err("the node has not finished its step within 10 s; it goes on as before".to_owned())
        };
        self.transport.serve_enable(&self.node_name, Box::new(enable))
    }

    /// Pauses the node or lets it go on. A paused node keeps its model and its parameters, and has no subscription, so
    /// that the frames of this time are no frames of the node and count nowhere.
    pub(super) fn enable(&mut self, request: &EnableRequest) -> Result<(), RunError> {
        if !request.claim.take() {
            return Ok(());
        }
        let enabled = request.enabled;
        if enabled != std::mem::replace(&mut self.enabled, enabled) {
            tracing::info!(node = %self.telemetry.node(), "{}", if enabled { "enabled" } else { "disabled" });
            if enabled {
                self.subscribe()?;
            } else {
                // From now on the counts of other nodes say nothing about the frames that this one should have.
                self.telemetry.report.swapped = true;
                self.inputs.close(false, &mut self.telemetry.report);
            }
            self.publish_state(Time::from_ns(self.time.now_ns()));
        }
        // Fails only when the caller has gone.
        let _ = request.answer.send(());
        Ok(())
    }

    /// Applies a request between two steps, or starts to make the part that it needs.
    pub(super) fn answer(&mut self, request: ParameterRequest) -> Result<(), RunError> {
        let expected = self.settings.read();
        self.prepare(PreparedRequest { request, expected, parts: Vec::new(), promised: false })
    }

    fn prepare(&mut self, mut prepared: PreparedRequest) -> Result<(), RunError> {
        while let Some(values) = prepared.request.changes.get(prepared.parts.len()) {
            if !prepared.promised && prepared.request.claim.is_taken() {
                break;
            }
            let part = match prepared.expected.with(values, true) {
                Err(why) => Err(why),
                Ok(next) => match self.node.prepare(&prepared.expected, &next) {
                    None => {
                        prepared.expected = next;
                        Ok(None)
                    }
                    // One at a time: each may take as much memory as a model.
                    Some(_) if self.loading.is_some() => {
                        let why = "the node is still loading what was asked for before; try again later";
                        Err(refusal(&prepared.expected, &next, why))
                    }
                    Some(job) => return self.load(job, next, prepared),
                },
            };
            prepared.parts.push(part);
        }
        self.apply(prepared)
    }

    /// Starts `job` on a thread of its own; its end comes as an event.
    fn load(&mut self, job: Job, next: Parameters, mut prepared: PreparedRequest) -> Result<(), RunError> {
        if !prepared.promise() {
            return Ok(());
        }
        let panicked = refusal(&prepared.expected, &next, PANICKED);
        match self.work_on(job, LiveEvent::Loaded, panicked) {
            Ok(work) => {
                self.loading = Some(Loading { prepared, next, work });
                self.publish_state(self.telemetry.diagnostics.next_stamp(&self.time));
                Ok(())
            }
            Err(why) => {
                prepared.parts.push(Err(refusal(&prepared.expected, &next, &why)));
                self.prepare(prepared)
            }
        }
    }

    /// Starts `job` on a thread of its own; its end comes as `event`, with the error `panicked` where it fails at a fault of the program.
    fn work_on(
        &self,
        job: Job,
        event: fn(Result<Part, ParameterError>) -> LiveEvent,
        panicked: ParameterError,
    ) -> Result<Work, String> {
        let (lane, queue) = (self.queue.open(Keep::Last(1)), self.queue.clone());
        let thread = std::thread::Builder::new().name("parts".into()).spawn(move || {
            // Without an answer, the request would wait for ever, and no other part could be made.
            let made = catch_unwind(AssertUnwindSafe(job)).unwrap_or(Err(panicked));
            drop(queue.push(lane, event(made)));
        });
        thread.map(|thread| Work { lane, thread }).map_err(|why| {
            self.queue.close(lane);
            format!("the system gives no thread: {why}")
        })
    }

    /// Closes the lane of `work`, which has sent its last event, and ends now.
    fn end(&self, work: Work) {
        self.queue.close(work.lane);
        let _ = work.thread.join();
    }

    /// Starts to make the part that a step has asked for.
    pub(super) fn make_beside(&mut self, job: Job) {
        let panicked = ParameterError::new("part", "of a step", PANICKED);
        match self.work_on(job, LiveEvent::Made, panicked) {
            Ok(work) => self.made_beside = Some(work),
            Err(why) => tracing::warn!(node = %self.telemetry.node(), "{why}"),
        }
    }

    /// Has the node take the part that a step has asked for.
    pub(super) fn made(&mut self, part: Result<Part, ParameterError>) {
        let work = self.made_beside.take().expect("only a part that is being made is made");
        self.end(work);
        match part {
            // Parameters that were set meanwhile may need another part, for which a step asks again.
            Ok(part) => drop(self.node.exchange(&self.settings.read(), part)),
            Err(why) => tracing::warn!(node = %self.telemetry.node(), "{why}"),
        }
    }

    /// Takes the part that was loaded, and goes on with its request.
    pub(super) fn loaded(&mut self, part: Result<Part, ParameterError>) -> Result<(), RunError> {
        let loading = self.loading.take().expect("only a part that is being loaded is loaded");
        let Loading { mut prepared, next, work } = loading;
        self.end(work);
        prepared.parts.push(part.map(|part| {
            prepared.expected = next;
            Some(part)
        }));
        self.prepare(prepared)
    }

    fn apply(&mut self, prepared: PreparedRequest) -> Result<(), RunError> {
        let PreparedRequest { request, parts, promised, .. } = prepared;
        // A caller that gave up has reported that the value is unchanged.
        if !promised && !request.claim.take() {
            return Ok(());
        }
        let changes = request.changes.iter().zip(parts);
        let answers: Vec<_> = changes.map(|(values, part)| self.change(values, part?)).collect();
        for why in answers.iter().filter_map(|answer| answer.as_ref().err()) {
            let now = self.time.ticks_ns();
            if let Some(warning) = self.refusals.note("refused parameters", &why.to_string(), now) {
                tracing::warn!(node = %self.telemetry.node(), "{warning}");
            }
        }
        if promised {
            self.publish_state(self.telemetry.diagnostics.next_stamp(&self.time));
        }
        // Fails only when the caller has gone.
        let _ = request.answer.send(ParameterAnswer::Done(answers));
        Ok(())
    }

    fn change(&mut self, values: &[(String, Value)], part: Option<Part>) -> Result<(), ParameterError> {
        let before = self.settings.read();
        let next = before.with(values, true)?;
        let refuse = |why: RunError| refusal(&before, &next, &why.to_string());
        let PlannedInputs { first, later } = self.node.inputs_with(&next)?;
        self.input_addresses(later, &next).map_err(refuse)?;
        let renewal = self.open_inputs(first, &next).map_err(refuse)?;
        let clock = self.time.open(&next, &self.node_name, self.transport).map_err(refuse)?;
        match part {
            None => self.node.configure(&next),
            Some(part) => self.node.exchange(&next, part),
        }?;
        self.renew_inputs(renewal);
        self.time.follow(clock);
        self.settings.change(&before, &next, &*self.node, self.time.now_ns());
        Ok(())
    }
}
