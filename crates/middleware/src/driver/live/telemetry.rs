//! [`Telemetry`]: what a live node reports of itself: its report, the copy of it on the disk, `/diagnostics`, `~/state` and the trace.

use std::collections::BTreeMap;

use modulo_msgs::std_msgs::Time;
use modulo_runtime::node::status_of;
use modulo_runtime::report::{add, hex};
use modulo_runtime::trace::{FlowPoint, Span, TraceFile};
use modulo_runtime::{Address, Clock, Node, NodeName, NodeReport, StepOutput, topic};

use super::inputs::Inputs;
use super::outputs::LiveOutput;
use crate::driver::RunError;
use crate::graph::diagnostics::{Diagnostics, StateTopic};
use crate::process::node_files::ReportFile;
use crate::transport::Transport;

pub(super) struct Telemetry {
    pub report: NodeReport,
    file: Option<ReportFile>,
    pub diagnostics: Diagnostics,
    pub state: StateTopic,
    /// The spans of this run, if its launcher wants them.
    trace: Option<TraceFile>,
}

pub(super) struct EndedStep<'a> {
    /// Ticks of its begin.
    pub begin: u64,
    pub output: &'a StepOutput,
    /// The stream that its input came on; a source reads none.
    pub stream: Option<&'a str>,
    /// Stamp of the input image.
    pub input: Option<Time>,
    /// Stamp of the image that it made.
    pub made: Option<Time>,
    /// Its place on the way of the frame.
    pub point: Option<FlowPoint>,
}

impl Telemetry {
    /// Opens the telemetry of the node `node_name`, which may publish diagnostics itself on one of its `outputs`.
    pub fn open(
        node_name: &NodeName,
        file: Option<ReportFile>,
        outputs: &[LiveOutput],
        transport: &dyn Transport,
        clock: &dyn Clock,
    ) -> Result<Self, RunError> {
        let diagnostics = Address::resolve(node_name, &topic::diagnostics())?;
        let diagnostics = match outputs.iter().find(|output| output.address.topic == diagnostics.topic) {
            Some(output) => output.publisher.clone(),
            None => transport.advertise(node_name, &diagnostics)?.into(),
        };
        let state = Address::resolve(node_name, &StateTopic::topic())?;
        Ok(Self {
            trace: TraceFile::of_launch(&node_name.fully_qualified(), clock),
            report: NodeReport::new(node_name.fully_qualified()),
            file,
            diagnostics: Diagnostics::new(diagnostics),
            state: StateTopic::new(transport.advertise(node_name, &state)?),
        })
    }

    /// Returns the fully qualified name of the node.
    pub fn node(&self) -> &str {
        &self.report.node
    }

    /// Records a step before its output is sent: messages that a crash keeps from being sent are then missed by their readers.
    pub fn record(&mut self, step: &EndedStep<'_>, outputs: &[LiveOutput], clock: &dyn Clock) {
        let &EndedStep { begin, output, stream, input, made, point } = step;
        if let Some(trace) = &self.trace {
            trace.add_step((begin, clock.ticks_ns()), output, input.or(made), point);
        }
        self.diagnostics.book(&output.stages, input.or(made.filter(|_| stream.is_none())));
        for (stage, duration) in &output.stages {
            self.report.book_stage(stage, *duration);
        }
        for (output, message) in &output.messages {
            if let Some(output) = outputs.get(*output) {
                self.report.book_published(output.route(message.kind()).0, message, stream);
            }
        }
        for output in &output.unwanted {
            if let Some(output) = outputs.get(*output) {
                add(&mut self.report.unwanted, &output.address.topic, 1);
            }
        }
    }

    /// Adds a span from `begin` to `end` to the trace, if it belongs to a frame.
    pub fn span(&self, name: &'static str, begin: u64, end: u64, frame: Option<Time>) {
        if let (Some(trace), Some(_)) = (&self.trace, frame) {
            trace.add(Span { name, begin, end, frame, flow: None });
        }
    }

    /// Brings the copy on the disk up to date when it is older than `pause_ns`.
    pub fn write_report(
        &mut self,
        pause_ns: u64,
        (inputs, outputs): (&Inputs<'_>, &[LiveOutput]),
        node: &dyn Node,
        clock: &dyn Clock,
    ) {
        let now = clock.ticks_ns();
        let Some(file) = self.file.as_mut().filter(|file| file.is_due(pause_ns, now)) else { return };
        // The counts of open subscriptions go into the copy, and into the report only when they are closed.
        let mut report = NodeReport { running: true, ..self.report.clone() };
        inputs.count(&mut report);
        report.sent = sent(outputs);
        report.status.extend(status_of(node));
        file.write(&report, now);
    }

    /// Publishes the counts on `/diagnostics` when that is due, with the `condition` that [`Diagnostics::publish`] takes.
    pub fn publish(
        &mut self,
        inputs: &Inputs<'_>,
        node: &dyn Node,
        condition: (bool, Option<&str>),
        clock: &dyn Clock,
    ) {
        if self.diagnostics.is_due(clock) {
            let mut report = self.report.clone();
            inputs.count(&mut report);
            self.diagnostics.publish(clock, &report, node, condition);
        }
    }

    /// Completes the report of a node that has ended, and writes it to the disk.
    pub fn close(
        mut self,
        outputs: &[LiveOutput],
        node: &dyn Node,
        has_failed: bool,
        now: u64,
    ) -> NodeReport {
        self.report.sent = sent(outputs);
        self.report.status.extend(status_of(node));
        // The report of a node that failed stays one of a node that crashed, whose frames are missing.
        self.report.running = has_failed;
        if let Some(file) = &mut self.file {
            file.write(&self.report, now);
        }
        self.report
    }
}

/// Returns how many messages have left each publisher of `outputs`, by topic and global id.
fn sent(outputs: &[LiveOutput]) -> BTreeMap<String, BTreeMap<String, u64>> {
    let mut sent: BTreeMap<String, BTreeMap<String, u64>> = BTreeMap::new();
    for (topic, publisher) in outputs.iter().flat_map(LiveOutput::publishers) {
        if let Some((publisher, count)) = publisher.sent() {
            sent.entry(topic.to_owned()).or_default().insert(hex(&publisher), count);
        }
    }
    sent
}
