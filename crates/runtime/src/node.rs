//! [`Node`]: a pure step, without thread, clock and transport; drivers bring those, and all execute the same code.

use std::any::Any;
use std::collections::BTreeSet;
use std::time::Duration;

use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::std_msgs::Time;

use crate::clock::Clock;
use crate::message::Message;
use crate::parameter::{ParameterError, Parameters};
use crate::topic::Topic;

/// The reason for a step.
#[derive(Clone, Debug)]
pub enum Trigger {
    /// A source's period has passed.
    Tick,
    /// A message came on `inputs()[input]`.
    Message {
        /// Index of the topic in [`Node::inputs`].
        input: usize,
        /// The message, of that topic's kind.
        message: Message,
    },
}

impl Trigger {
    /// Returns the stamp of the image that the step is about.
    pub fn frame(&self) -> Option<Time> {
        match self {
            Self::Message { message: Message::Image(image), .. } => Some(image.header.stamp),
            _ => None,
        }
    }
}

/// The state of a node after a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flow {
    /// Further steps may follow.
    Continue,
    /// The message is deferred to a later step.
    Deferred,
    /// Further steps may follow, and [`Node::inputs`] has changed with this one.
    NewInputs,
    /// The source is exhausted: this node ends, and with it those that only read from it.
    Done,
}

/// Error: a step gave no result.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StepError {
    /// This input is bad: it is counted, logged and skipped, and the node continues.
    #[error("{0}")]
    Skip(String),
    /// The node cannot go on.
    #[error("{0}")]
    Fatal(String),
}

/// The topics that a node reads after a change of its parameters.
pub struct PlannedInputs {
    /// Those that [`Node::inputs`] returns right after the change.
    pub first: Vec<Topic>,
    /// Those that a later step may bring with [`Flow::NewInputs`].
    pub later: Vec<Topic>,
}

/// A part of a node that takes long to make, such as a loaded model.
pub type Part = Box<dyn Any + Send>;

/// Makes a [`Part`]. A driver runs it on a thread of its own, while the node goes on with the part that it has.
pub type Job = Box<dyn FnOnce() -> Result<Part, ParameterError> + Send>;

/// A node of the suite.
pub trait Node: Send {
    /// Returns the topics that the node reads now. They may change with [`Node::configure`], and with a step that returns
    /// [`Flow::NewInputs`]; the driver then renews the subscriptions.
    fn inputs(&self) -> Vec<Topic>;

    /// Returns the topics that the node would read with the parameters `next`. The driver subscribes to them before the
    /// node takes `next`, and refuses the change where it cannot. A node whose parameters name no topic keeps its inputs.
    ///
    /// # Errors
    /// [`ParameterError`] with the parameter, its value and the possible values.
    fn inputs_with(&self, next: &Parameters) -> Result<PlannedInputs, ParameterError> {
        let _ = next;
        Ok(PlannedInputs { first: self.inputs(), later: Vec::new() })
    }

    /// Returns the topics written, fixed for the life of the node; [`Context::emit`] takes an index into this list.
    fn outputs(&self) -> Vec<Topic>;

    /// Returns the period of a source, at which [`Trigger::Tick`] comes (zero: without a pause); `None` for others.
    fn period(&self) -> Option<Duration> {
        None
    }

    /// Returns how many frames a source that can go on at any frame has taken from its data so far. It is kept
    /// before the frame is sent, so that a crash between the two loses this frame and never sends one twice.
    fn position(&self) -> Option<u64> {
        None
    }

    /// Resumes after the first `position` frames, which an earlier life has taken; called before the first step.
    fn resume(&mut self, position: u64) {
        let _ = position;
    }

    /// Sends what other nodes need to get ready for the first frame, such as the description of a sensor. A driver of live nodes calls
    /// it once, before it waits for other nodes.
    fn introduce(&mut self, cx: &mut Context<'_>) {
        let _ = cx;
    }

    /// Gets ready for the first frame, as far as it is known what will come. A driver of live nodes calls it before the node reports
    /// ready. It returns the inputs that would tell more: the driver waits for a message on those that are published, for at most
    /// half a second, and calls it again after each one.
    fn get_ready(&mut self) -> Vec<Topic> {
        Vec::new()
    }

    /// Takes a whole validated set of parameters, between two steps. Files are read in the job of [`Node::prepare`].
    ///
    /// # Errors
    /// [`ParameterError`] with the parameter, its value and the possible values; the node then continues as before.
    fn configure(&mut self, parameters: &Parameters) -> Result<(), ParameterError>;

    /// Returns the job that makes the part which the change from `now` to `next` needs; `None` when it needs none.
    fn prepare(&self, now: &Parameters, next: &Parameters) -> Option<Job> {
        let _ = (now, next);
        None
    }

    /// Takes a set of parameters as [`Node::configure`] does, together with the `part` that was made for it, or for the steps that
    /// come ([`Context::make_beside`]).
    ///
    /// # Errors
    /// The same as those of [`Node::configure`].
    fn exchange(&mut self, parameters: &Parameters, part: Part) -> Result<(), ParameterError> {
        drop(part);
        self.configure(parameters)
    }

    /// Does the work for one trigger.
    ///
    /// # Errors
    /// [`StepError::Skip`] for a bad input, [`StepError::Fatal`] when the node cannot go on.
    fn step(&mut self, trigger: Trigger, cx: &mut Context<'_>) -> Result<Flow, StepError>;

    /// Discards the message that a step has deferred ([`Flow::Deferred`]), since what it waits for has not come within about a second.
    /// Returns the reason, with which it counts as skipped; `None` when no message is deferred.
    fn give_up(&mut self) -> Option<String> {
        None
    }

    /// Returns the values in use as (key, value) pairs for the topic `~/state`, such as `("engine", "rten")`. They change
    /// with parameters and with the sensor, and are no counts. The driver adds the name of the stream.
    fn state(&self) -> Vec<(&'static str, String)> {
        Vec::new()
    }

    /// Returns the status of the node as (key, value) pairs for diagnostics and the summary, such as `("engine",
    /// "rten")` and `("stream", "recovered")`.
    fn status(&self) -> Vec<(&'static str, String)> {
        Vec::new()
    }
}

/// Returns the declared name of the stream that the message of `trigger` came on; a source reads no stream.
pub fn stream_of(node: &dyn Node, trigger: &Trigger) -> Option<String> {
    match trigger {
        Trigger::Message { input, .. } => node.inputs().get(*input).map(|topic| topic.name.clone()),
        Trigger::Tick => None,
    }
}

/// Returns the message on `~/state` of the node `name`: the values that it uses from the frame of `stamp` on.
pub fn state_of(name: &str, stamp: Time, values: &[(&'static str, String)]) -> Message {
    let (level, message) = (DiagnosticStatus::OK, "in use".to_owned());
    let name = format!("{}: state", name.trim_start_matches('/'));
    let values = KeyValue::all(values.iter().cloned());
    let status = DiagnosticStatus { level, name, message, values, ..DiagnosticStatus::default() };
    DiagnosticArray::of(stamp, status).into()
}

/// Returns the status of a node as its report has it.
pub fn status_of(node: &dyn Node) -> impl Iterator<Item = (String, String)> {
    node.status().into_iter().map(|(key, value)| (key.to_owned(), value))
}

/// The services that a driver offers to one step.
pub struct Context<'a> {
    node: &'a str,
    /// The topics of the outputs, absolute and remapped, if the driver names them.
    pub topics: &'a [&'a str],
    /// The declared stream of the message that the step is about ([`stream_of`]), which may be one that the node is leaving.
    pub stream: Option<&'a str>,
    clock: &'a dyn Clock,
    wanted: &'a [bool],
    /// Whether the driver, which makes parts beside the steps, is making one; `None` where it never does.
    pub busy: Option<bool>,
    output: StepOutput,
}

impl<'a> Context<'a> {
    /// Creates the context of one step. `node` is the fully qualified name of the node, such as `/unwrap`; `wanted[i]`
    /// is whether `outputs()[i]` has a reader.
    pub fn new(node: &'a str, clock: &'a dyn Clock, wanted: &'a [bool]) -> Self {
        let output = StepOutput::default();
        Self { node, topics: &[], stream: None, clock, wanted, busy: None, output }
    }

    /// Returns the topic of output `output`, absolute and remapped, if the driver has named it.
    pub fn topic(&self, output: usize) -> Option<&'a str> {
        self.topics.get(output).copied()
    }

    /// Has the driver make a part on a thread of its own, while the node goes on with what it has; [`Node::exchange`] brings it.
    /// Returns whether the driver makes one now: `job` is not asked for where it does so already. Where it makes none, as in lockstep,
    /// the step itself waits for what it needs.
    pub fn make_beside(&mut self, job: impl FnOnce() -> Option<Job>) -> bool {
        if self.busy == Some(false) {
            self.output.job = job();
        }
        self.busy == Some(true) || self.output.job.is_some()
    }

    /// Returns the fully qualified name of the node, such as `/unwrap`.
    pub fn node(&self) -> &'a str {
        self.node
    }

    /// Returns the nanoseconds since the epoch, as the driver sees the time.
    pub fn now_ns(&self) -> u64 {
        self.clock.now_ns()
    }

    /// Returns whether output `output` has a reader; a message without one need not be made. A step asks when it has a
    /// message to send: a message that is not made then is counted as unwanted.
    pub fn wanted(&mut self, output: usize) -> bool {
        // Asked once before the step: a reader that comes during it gets the next message.
        let wanted = self.wanted.get(output).copied().unwrap_or(false);
        if !wanted {
            self.output.unwanted.insert(output);
        }
        wanted
    }

    /// Sends `message` on output `output` when the step has returned.
    pub fn emit(&mut self, output: usize, message: impl Into<Message>) {
        self.output.messages.push((output, message.into()));
    }

    /// Runs `work` and books its duration under `stage` (`unwrap`, `infer`, ...).
    pub fn stage<T>(&mut self, stage: &'static str, work: impl FnOnce() -> T) -> T {
        let start = self.clock.ticks_ns();
        let result = work();
        self.output.stages.push((stage, self.clock.ticks_ns().saturating_sub(start)));
        self.output.begins.push(start);
        result
    }

    /// Returns the output of the step.
    pub fn finish(self) -> StepOutput {
        self.output
    }
}

/// The output of one step for its driver.
#[derive(Default)]
pub struct StepOutput {
    /// Messages to send, by output.
    pub messages: Vec<(usize, Message)>,
    /// Outputs for which the step had a message that it did not make, because they have no reader.
    pub unwanted: BTreeSet<usize>,
    /// Durations of its stages, nanoseconds.
    pub stages: Vec<(&'static str, u64)>,
    /// Ticks of the clock at which these stages began, in the same order.
    pub begins: Vec<u64>,
    /// The part to make beside the next steps.
    pub job: Option<Job>,
}
