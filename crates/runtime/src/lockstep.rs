//! The lockstep driver: every message once, in order, nothing dropped, one thread: the same in, the same out.

use std::collections::VecDeque;

use modulo_msgs::std_msgs::Time;

use crate::clock::{Clock, ManualClock};
use crate::message::Message;
use crate::name::{NameError, NodeName};
use crate::node::{Context, Flow, Node, StepError, StepOutput, Trigger, state_of, status_of, stream_of};
use crate::report::{NodeReport, add};
use crate::topic::{Address, addresses};
use crate::trace::TraceFile;

/// Error: a chain cannot go on.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LockstepError {
    /// The name of a topic is not valid.
    #[error(transparent)]
    Name(#[from] NameError),
    /// The step of a node, with its name, cannot go on.
    #[error("{0}: {1}")]
    Fatal(String, String),
}

/// A chain of nodes that are stepped one message at a time.
pub struct Lockstep<'a> {
    members: Vec<ChainMember>,
    timer: &'a dyn Clock,
    recorded: Vec<String>,
    stages: Vec<(&'static str, u64)>,
}

struct ChainMember {
    node: Box<dyn Node>,
    node_name: NodeName,
    inputs: Vec<Address>,
    outputs: Vec<Address>,
    report: NodeReport,
    /// The spans of its steps, if they are wanted.
    trace: Option<TraceFile>,
    /// The values that its last message on `~/state` had.
    state: Vec<(&'static str, String)>,
}

impl ChainMember {
    /// Counts and reports the failure of a step; after one that is only skipped the run goes on, as a live node does.
    fn settle(&mut self, failure: StepError, topic: &str) -> Result<Flow, LockstepError> {
        match failure {
            StepError::Skip(why) => {
                tracing::warn!(node = %self.report.node, topic, "skipped: {why}");
                add(&mut self.report.bad, topic, 1);
                Ok(Flow::Continue)
            }
            StepError::Fatal(why) => Err(LockstepError::Fatal(self.report.node.clone(), why)),
        }
    }
}

/// A message on a topic.
pub type OnTopic = (String, Message);

impl<'a> Lockstep<'a> {
    /// Creates an empty chain. `timer` measures stages and nothing else: no step sees it. Messages on the topics of
    /// `recorded` count as wanted and are handed out by [`Lockstep::feed`].
    pub fn new(timer: &'a dyn Clock, recorded: Vec<String>) -> Self {
        Self { members: Vec::new(), timer, recorded, stages: Vec::new() }
    }

    /// Adds a node. Messages reach nodes in the order in which these were added.
    ///
    /// # Errors
    /// [`LockstepError::Name`] when one of its topics is not a valid ROS name.
    pub fn add(&mut self, node: Box<dyn Node>, node_name: &NodeName) -> Result<(), LockstepError> {
        let inputs = addresses(node_name, &node.inputs())?;
        let outputs = addresses(node_name, &node.outputs())?;
        self.members.push(ChainMember {
            node,
            node_name: node_name.clone(),
            inputs,
            outputs,
            report: NodeReport::new(node_name.fully_qualified()),
            trace: TraceFile::of_launch(&node_name.fully_qualified(), self.timer),
            state: Vec::new(),
        });
        Ok(())
    }

    /// Lets source `member` make its next frame at `now_ns` and carries it through the chain; `None` at its end.
    ///
    /// # Errors
    /// [`LockstepError::Fatal`] when a step cannot go on.
    pub fn tick(&mut self, member: usize, now_ns: u64) -> Result<Option<Vec<OnTopic>>, LockstepError> {
        self.stages.clear();
        let mut pending = VecDeque::new();
        let flow = self.step(member, Trigger::Tick, "source", now_ns, &mut pending)?;
        let out = self.carry(pending, now_ns)?;
        // A source may send its last frame with the step that ends it.
        Ok((flow == Flow::Continue || !out.is_empty()).then_some(out))
    }

    /// Puts `node` in the place of `member`, whose name and topics it has.
    pub fn exchange(&mut self, member: usize, node: Box<dyn Node>) {
        self.members[member].node = node;
    }

    /// Lets source `member` go on after its first `position` frames.
    pub fn resume(&mut self, member: usize, position: u64) {
        self.members[member].node.resume(position);
    }

    /// Returns the number of frames that source `member` has taken; `None` for a node without a position.
    pub fn position(&self, member: usize) -> Option<u64> {
        self.members[member].node.position()
    }

    /// Carries one message from outside through the chain; returns what came out on recorded topics, in order.
    ///
    /// # Errors
    /// [`LockstepError::Fatal`] when a step cannot go on.
    pub fn feed(
        &mut self,
        topic: &str,
        message: Message,
        now_ns: u64,
    ) -> Result<Vec<OnTopic>, LockstepError> {
        self.stages.clear();
        self.carry(VecDeque::from([(topic.to_owned(), message)]), now_ns)
    }

    /// Returns the durations of the stages of the last tick or feed, ns, in the order in which they ended.
    pub fn stages(&self) -> &[(&'static str, u64)] {
        &self.stages
    }

    /// Returns the counts and durations of each node so far, without the status of the nodes.
    pub fn reports(&self) -> Vec<NodeReport> {
        self.members.iter().map(|member| member.report.clone()).collect()
    }

    /// Ends the chain and returns the report of each node.
    pub fn finish(self) -> Vec<NodeReport> {
        self.members
            .into_iter()
            .map(|mut member| {
                member.report.status.extend(status_of(&*member.node));
                member.report
            })
            .collect()
    }

    fn carry(&mut self, mut pending: VecDeque<OnTopic>, now_ns: u64) -> Result<Vec<OnTopic>, LockstepError> {
        let mut out = Vec::new();
        // First in, first out: the messages of a step go on in the order in which it sent them.
        while let Some((topic, message)) = pending.pop_front() {
            for index in 0..self.members.len() {
                let inputs = &self.members[index].inputs;
                let Some(input) = inputs.iter().position(|a| a.topic == topic && a.kind == message.kind())
                else {
                    continue;
                };
                add(&mut self.members[index].report.received, &topic, 1);
                if let Message::Image(image) = &message {
                    self.tell_state(index, image.header.stamp, &mut pending);
                }
                let trigger = Trigger::Message { input, message: message.clone() };
                self.step(index, trigger, &topic, now_ns, &mut pending)?;
            }
            if self.recorded.contains(&topic) {
                out.push((topic, message));
            }
        }
        Ok(out)
    }

    fn step(
        &mut self,
        index: usize,
        trigger: Trigger,
        topic: &str,
        now_ns: u64,
        pending: &mut VecDeque<OnTopic>,
    ) -> Result<Flow, LockstepError> {
        let wanted: Vec<bool> =
            self.members[index].outputs.iter().map(|a| self.is_wanted(&a.topic)).collect();
        // A step sees the time of its frame only, so that a run gives the same bytes on every machine.
        let clock = StepClock { now: ManualClock::at(now_ns), timer: self.timer };
        let member = &mut self.members[index];
        let stream = stream_of(&*member.node, &trigger);
        let (frame, begin) = (trigger.frame(), clock.ticks_ns());
        let topics: Vec<&str> = member.outputs.iter().map(|address| &*address.topic).collect();
        let stream = stream.as_deref();
        let mut cx = Context::new(&member.report.node, &clock, &wanted);
        (cx.topics, cx.stream) = (&topics, stream);
        let result = member.node.step(trigger, &mut cx);
        let output = cx.finish();
        if let Some(trace) = &member.trace {
            trace.add_step((begin, clock.ticks_ns()), &output, frame, None);
        }
        let StepOutput { messages, stages, .. } = output;
        for (stage, duration) in stages {
            member.report.book_stage(stage, duration);
            self.stages.push((stage, duration));
        }
        for (output, message) in messages {
            if let Some(address) = member.outputs.get(output) {
                member.report.book_published(&address.topic, &message, stream);
                pending.push_back((address.topic.clone(), message));
            }
        }
        if result == Ok(Flow::NewInputs) {
            member.inputs = addresses(&member.node_name, &member.node.inputs())?;
        }
        result.or_else(|error| member.settle(error, topic))
    }

    /// Sends the status of a node whose `~/state` is recorded, if it has changed.
    fn tell_state(&mut self, index: usize, stamp: Time, pending: &mut VecDeque<OnTopic>) {
        let member = &mut self.members[index];
        let topic = format!("{}/state", member.report.node);
        if !self.recorded.contains(&topic) {
            return;
        }
        let state = member.node.status();
        if member.state != state {
            pending.push_back((topic, state_of(&member.report.node, stamp, &state)));
            member.state = state;
        }
    }

    fn is_wanted(&self, topic: &str) -> bool {
        self.recorded.iter().any(|t| t == topic)
            || self.members.iter().any(|m| m.inputs.iter().any(|a| a.topic == topic))
    }
}

/// Stamps come from the message at hand, durations from the timer.
struct StepClock<'a> {
    now: ManualClock,
    timer: &'a dyn Clock,
}

impl Clock for StepClock<'_> {
    fn now_ns(&self) -> u64 {
        self.now.now_ns()
    }

    fn ticks_ns(&self) -> u64 {
        self.timer.ticks_ns()
    }
}
