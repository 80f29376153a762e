//! One step of a live node: its input, the messages that it makes, and their way out.

use modulo_msgs::std_msgs::Time;
use modulo_runtime::report::add;
use modulo_runtime::trace::FlowPoint;
use modulo_runtime::{Clock, Context, Flow, Message, MessageKind, Node, StepError, StepOutput, Trigger};

use super::Live;
use super::outputs::LiveOutput;
use super::telemetry::EndedStep;
use crate::driver::{CommonParameters, RunError};
use crate::process::node_files::{AFTER_STEP_NS, IDLE_NS};

impl Live<'_> {
    /// Runs one step; returns the messages that it left. `topic` is named when the step skips its input, which came on
    /// `stream`; a source reads no stream. `frame` is the stamp of an input image.
    pub(super) fn step(
        &mut self,
        trigger: Trigger,
        topic: &str,
        stream: Option<&str>,
        frame: Option<Time>,
    ) -> Result<(Flow, Vec<(usize, Message)>), RunError> {
        let begin = self.time.ticks_ns();
        let (result, mut output) = self.in_context(stream, |node, cx| node.step(trigger, cx));
        if let Some(job) = output.job.take() {
            self.make_beside(job);
        }
        output.messages = self.with_compressed(output.messages);
        let image = output.messages.iter().find(|(_, message)| message.kind() == MessageKind::Image);
        let made = image.map(|(_, message)| message.stamp());
        let point = match made {
            _ if result == Ok(Flow::Deferred) => None,
            Some(_) if stream.is_none() => Some(FlowPoint::Source),
            Some(_) => Some(FlowPoint::Pass),
            None => frame.map(|_| FlowPoint::End),
        };
        let ended = EndedStep { begin, output: &output, stream, input: frame, made, point };
        self.telemetry.record(&ended, &self.outputs, &self.time);
        // Before the messages of the first frame that was made with these values.
        if let Some((_, first)) = output.messages.first() {
            self.publish_state(first.stamp());
        }
        self.settle(result, output.messages, topic, stream.is_none())
    }

    /// Has the node do `work` for a message of `stream`; returns its result, and what it has left to the driver.
    fn in_context<T>(
        &mut self,
        stream: Option<&str>,
        work: impl FnOnce(&mut dyn Node, &mut Context<'_>) -> T,
    ) -> (T, StepOutput) {
        let wanted: Vec<bool> = self.outputs.iter().map(LiveOutput::wanted).collect();
        let topics: Vec<&str> = self.outputs.iter().map(|output| &*output.address.topic).collect();
        let mut cx = Context::new(self.telemetry.node(), &self.time, &wanted);
        (cx.topics, cx.stream, cx.busy) = (&topics, stream, Some(self.made_beside.is_some()));
        let result = work(&mut *self.node, &mut cx);
        (result, cx.finish())
    }

    /// Sends what the node introduces itself with.
    pub(super) fn introduce(&mut self) {
        let begin = self.time.ticks_ns();
        let ((), output) = self.in_context(None, |node, cx| node.introduce(cx));
        let ended = EndedStep { begin, output: &output, stream: None, input: None, made: None, point: None };
        self.telemetry.record(&ended, &self.outputs, &self.time);
        self.send_all(&output.messages);
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
            // Each frame of a source is reported: its name is in the text.
            Err(StepError::Skip(why)) if is_source => {
                tracing::warn!(node = %self.telemetry.node(), topic, "skipped: {why}");
                add(&mut self.telemetry.report.bad, topic, 1);
                Ok((Flow::Continue, messages))
            }
            Err(StepError::Skip(why)) => {
                self.skip(topic, &why);
                Ok((Flow::Continue, messages))
            }
            Err(StepError::Fatal(why)) => {
                if !is_source {
                    add(&mut self.telemetry.report.bad, topic, 1);
                }
                // They are counted as sent already, and were made before the step failed.
                self.send_all(&messages);
                Err(RunError::Fatal(self.telemetry.node().to_owned(), why))
            }
        }
    }

    /// Adds the compressed variants that have readers to the messages of a step. An image whose compressed variant alone has
    /// readers is replaced by it.
    fn with_compressed(&mut self, messages: Vec<(usize, Message)>) -> Vec<(usize, Message)> {
        let mut all = Vec::with_capacity(messages.len());
        for (index, message) in messages {
            let format = || CommonParameters::from(&self.settings.read()).compressed_format;
            let start = self.time.ticks_ns();
            let Some(output) = self.outputs.get(index) else { continue };
            match output.compress(&message, format) {
                None => all.push((index, message)),
                Some(Ok(file)) => {
                    if output.publisher.wanted() {
                        all.push((index, message));
                    }
                    all.push((index, file));
                    self.telemetry.report.book_stage("compress", self.time.ticks_ns() - start);
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

    /// Brings the accounts on the disk up to date, and then sends `messages`.
    pub(super) fn send_all(&mut self, messages: &[(usize, Message)]) {
        // The account of a source is never behind the frames that it has sent. A description just before a frame must not delay that
        // of the frame.
        self.write_report(match (self.node.period(), messages) {
            (Some(_), _) => 0,
            (None, []) => IDLE_NS,
            (None, _) => AFTER_STEP_NS,
        });
        // Before the frame leaves: a crash in between loses it, but never sends it twice.
        self.settings.keep_position(&*self.node);
        let begin = self.time.ticks_ns();
        for (output, message) in messages {
            let Some(output) = self.outputs.get(*output) else { continue };
            let (topic, publisher) = output.route(message.kind());
            if let Err(why) = publisher.put(message) {
                tracing::warn!(node = %self.telemetry.node(), "{why}");
                add(&mut self.telemetry.report.bad, topic, 1);
            }
        }
        let of_a_frame = |kind| matches!(kind, MessageKind::Image | MessageKind::Detections);
        let mut sent = messages.iter().filter(|(_, message)| of_a_frame(message.kind()));
        let frame = sent.next().map(|(_, message)| message.stamp());
        self.telemetry.span("send", begin, self.time.ticks_ns(), frame);
        self.report_when_due();
    }
}
