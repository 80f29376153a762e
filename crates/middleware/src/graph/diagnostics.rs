//! [`Diagnostics`]: publishes the counts and the durations of the stages of a node on `/diagnostics`, once a second; and
//! [`StateTopic`]: publishes the values that a node uses on `~/state`, when they change.

use std::collections::BTreeMap;
use std::rc::Rc;

use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::std_msgs::Time;
use modulo_runtime::node::{state_of, status_of};
use modulo_runtime::report::quantile;
use modulo_runtime::{Clock, MessageKind, Node, NodeReport, Qos, Topic};

use crate::transport::Publisher;

/// Key of the last message on `~/state` of a node whose frames are over. A node that crashes or is asked to end does not send it.
pub const ENDED: &str = "ended";

const PERIOD_NS: u64 = 1_000_000_000;

/// The `/diagnostics` publisher of one node.
pub struct Diagnostics {
    publisher: Rc<dyn Publisher>,
    due: u64,
    /// Messages that had been skipped when the last message was published.
    bad: u64,
    /// The work of the node since the last message.
    window: Window,
    last_frame: Option<Time>,
}

/// The frames of the last second or so.
#[derive(Default)]
struct Window {
    /// Ticks of its begin.
    since: u64,
    frames: u32,
    /// Sum of the durations in ns, and their number, by stage.
    stages: BTreeMap<&'static str, (u64, u32)>,
}

impl Diagnostics {
    /// Publishes with `publisher`.
    pub fn new(publisher: Rc<dyn Publisher>) -> Self {
        Self { publisher, due: 0, bad: 0, window: Window::default(), last_frame: None }
    }

    /// Notes the durations of the stages of a step, ns, and the stamp of its frame if it was one of an image.
    pub fn book(&mut self, stages: &[(&'static str, u64)], frame: Option<Time>) {
        for (stage, duration) in stages {
            let (sum, count) = self.window.stages.entry(stage).or_default();
            (*sum, *count) = (*sum + duration, *count + 1);
        }
        self.window.frames += u32::from(frame.is_some());
        self.last_frame = frame.or(self.last_frame);
    }

    /// Returns the first stamp behind that of the last frame; before the first frame the time of `clock`.
    pub fn next_stamp(&self, clock: &dyn Clock) -> Time {
        Time::from_ns(self.last_frame.map_or(clock.now_ns(), |stamp| stamp.as_ns().saturating_add(1)))
    }

    /// Returns whether a second has passed since the last message, and the topic has a reader.
    pub fn is_due(&mut self, clock: &dyn Clock) -> bool {
        let now = clock.ticks_ns();
        let wanted = self.publisher.wanted();
        if !wanted {
            // The first message for a new reader is not about the hours before it, nor about the last milliseconds.
            if now.saturating_sub(self.window.since) >= PERIOD_NS {
                self.window = Window { since: now, ..Window::default() };
            }
            self.due = self.window.since + PERIOD_NS / 2;
        }
        wanted && now >= self.due
    }

    /// Publishes `report` of a node that is `enabled`, or was disabled by the service `~/enable`. The level is WARN when messages
    /// were skipped since the last time, and with a `warning` that no input comes.
    pub fn publish(
        &mut self,
        clock: &dyn Clock,
        report: &NodeReport,
        node: &dyn Node,
        (enabled, warning): (bool, Option<&str>),
    ) {
        let now = clock.ticks_ns();
        self.due = now + PERIOD_NS;
        let window = std::mem::replace(&mut self.window, Window { since: now, ..Window::default() });
        let mut values = window.values(now);
        if let Some(stamp) = self.last_frame {
            let age = i128::from(clock.now_ns()) - i128::from(stamp.as_ns());
            values.push(("age_ms".to_owned(), format!("{:.3}", age as f64 / 1e6)));
        }
        values.push(("enabled".to_owned(), enabled.to_string()));
        let dropped: u64 = report.dropped().values().sum();
        values.push(("dropped_frames".to_owned(), dropped.to_string()));
        let bad = report.bad.values().sum();
        let skipped = bad - std::mem::replace(&mut self.bad, bad);
        let level = level_of(enabled, warning, skipped);
        let message = describe(clock.now_ns(), report, node, values, level);
        if let Err(why) = self.publisher.put(&message.into()) {
            // A warning each second about the same fault would hide all others.
            tracing::debug!("{why}");
        }
    }
}

impl Window {
    /// Returns the rate of the frames, and the mean duration of each stage, at the ticks `now`.
    fn values(&self, now: u64) -> Vec<(String, String)> {
        let seconds = now.saturating_sub(self.since) as f64 / 1e9;
        let rate = if seconds > 0.0 { f64::from(self.frames) / seconds } else { 0.0 };
        let mut values = vec![("rate_hz".to_owned(), format!("{rate:.2}"))];
        values.extend(self.stages.iter().map(|(stage, (sum, count))| {
            (format!("{stage}_ms"), format!("{:.3}", *sum as f64 / 1e6 / f64::from(*count)))
        }));
        values
    }
}

fn describe(
    now_ns: u64,
    report: &NodeReport,
    node: &dyn Node,
    recent: Vec<(String, String)>,
    (level, message): (u8, String),
) -> DiagnosticArray {
    // Viewers of diagnostics show these pairs as they are, so the units stand in the keys.
    let mut values: Vec<(String, String)> = status_of(node).chain(recent).collect();
    for (what, counts) in [
        ("received", &report.received),
        ("published", &report.published),
        ("replaced", &report.replaced),
        ("lost", &report.lost),
        ("bad", &report.bad),
    ] {
        for (topic, count) in counts {
            values.push((format!("{what} {topic}"), count.to_string()));
        }
    }
    for (stage, histogram) in &report.stages {
        for (name, q) in [("p50", 0.5), ("p99", 0.99)] {
            if let Some(us) = quantile(histogram, q) {
                values.push((format!("{stage} {name} ms"), format!("{:.3}", us as f64 / 1000.0)));
            }
        }
    }
    // Names of statuses have no leading slash, as those of `diagnostic_updater`.
    let (name, values) = (report.node.trim_start_matches('/').to_owned(), KeyValue::all(values));
    let status = DiagnosticStatus { level, name, message, values, ..DiagnosticStatus::default() };
    DiagnosticArray::of(Time::from_ns(now_ns), status)
}

/// Returns the level and the text of the status of a node.
fn level_of(enabled: bool, warning: Option<&str>, skipped: u64) -> (u8, String) {
    match (warning, skipped) {
        _ if !enabled => {
            (DiagnosticStatus::OK, "disabled; call ~/enable with data: true to go on".to_owned())
        }
        (Some(warning), _) => (DiagnosticStatus::WARN, warning.to_owned()),
        (None, 0) => (DiagnosticStatus::OK, "running".to_owned()),
        (None, _) => (DiagnosticStatus::WARN, format!("{skipped} bad messages were skipped")),
    }
}

/// The `~/state` publisher of one node: the values in use, latched and stamped with the first frame that they hold for.
pub struct StateTopic {
    publisher: Box<dyn Publisher>,
    last: Option<Vec<(&'static str, String)>>,
}

impl StateTopic {
    /// Returns the topic, a `diagnostic_msgs/msg/DiagnosticArray`, which every ROS 2 node can read.
    pub fn topic() -> Topic {
        Topic { qos: Qos::Latched, ..Topic::new("~/state", MessageKind::Diagnostics) }
    }

    /// Publishes with `publisher`.
    pub fn new(publisher: Box<dyn Publisher>) -> Self {
        Self { publisher, last: None }
    }

    /// Publishes the values that `node`, which is called `name`, uses from the frame of `stamp` on, if they have changed.
    /// `of_driver` are the values that the node itself does not know, such as the name of the stream that it answers.
    pub fn publish(
        &mut self,
        stamp: Time,
        name: &str,
        node: &dyn Node,
        of_driver: Vec<(&'static str, String)>,
    ) {
        let state = [node.state(), of_driver].concat();
        if self.last.as_ref() != Some(&state) {
            self.put(stamp, name, &state);
            self.last = Some(state);
        }
    }

    /// Publishes that the node, which is called `name`, ends because its frames are over ([`ENDED`]), beside the last values.
    pub fn publish_end(&mut self, stamp: Time, name: &str) {
        let mut state = self.last.take().unwrap_or_default();
        state.push((ENDED, "true".to_owned()));
        self.put(stamp, name, &state);
    }

    fn put(&self, stamp: Time, name: &str, state: &[(&'static str, String)]) {
        if let Err(why) = self.publisher.put(&state_of(name, stamp, state)) {
            tracing::warn!("{why}");
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;
    use std::time::Duration;

    use super::*;
    use crate::transport::local::LocalTransport;
    use crate::transport::{Incoming, Transport};
    use modulo_runtime::Message;
    use modulo_runtime::report::add;
    use modulo_runtime::{
        Address, Context, Flow, ManualClock, NodeName, ParameterError, Parameters, StepError, Trigger,
    };

    struct Idle;

    impl Node for Idle {
        fn inputs(&self) -> Vec<Topic> {
            Vec::new()
        }
        fn outputs(&self) -> Vec<Topic> {
            Vec::new()
        }
        fn configure(&mut self, _: &Parameters) -> Result<(), ParameterError> {
            Ok(())
        }
        fn step(&mut self, _: Trigger, _: &mut Context<'_>) -> Result<Flow, StepError> {
            Ok(Flow::Done)
        }
    }

    #[test]
    fn the_first_message_for_a_new_reader_is_about_half_a_second_at_least() {
        let transport = LocalTransport::default();
        let node_name = NodeName::new("unwrap", "/", &[]).expect("names");
        let address = Address::resolve(&node_name, &modulo_runtime::topic::diagnostics()).expect("a name");
        let mut diagnostics =
            Diagnostics::new(transport.advertise(&node_name, &address).expect("local").into());
        let clock = ManualClock::at(0);
        clock.set(7 * PERIOD_NS);
        assert!(!diagnostics.is_due(&clock), "nobody reads");
        let (sender, arrived) = channel();
        let deliver = Box::new(move |incoming| sender.send(incoming).expect("the test listens"));
        let _subscription = transport.subscribe(&node_name, &address, deliver).expect("local");
        for _ in 0..6 {
            clock.set(clock.now_ns() + PERIOD_NS / 10);
            diagnostics.book(&[], Some(Time::from_ns(clock.now_ns())));
            if diagnostics.is_due(&clock) {
                diagnostics.publish(&clock, &NodeReport::new("/unwrap"), &Idle, (true, None));
            }
        }
        let Ok(Incoming::Message(Message::Diagnostics(array))) = arrived.try_recv() else {
            panic!("a message")
        };
        let rate = array.status[0].values.iter().find(|pair| pair.key == "rate_hz").expect("a rate");
        assert_eq!(rate.value, "10.00");
        assert!(arrived.try_recv().is_err(), "once a second");
    }

    #[test]
    fn the_topic_is_remapped_and_a_warning_ends_with_its_cause() {
        let transport = LocalTransport::default();
        let remaps = [("/diagnostics".to_owned(), "/health".to_owned())];
        let node_name = NodeName::new("unwrap", "/", &remaps).expect("names");
        let (sender, arrived) = channel();
        let deliver = Box::new(move |incoming| sender.send(incoming).expect("the test listens"));
        let address = Address::resolve(&node_name, &modulo_runtime::topic::diagnostics()).expect("a name");
        assert_eq!(address.topic, "/health");
        let _subscription = transport.subscribe(&node_name, &address, deliver).expect("local");
        let publisher = transport.advertise(&node_name, &address).expect("local");
        let mut diagnostics = Diagnostics::new(publisher.into());
        let clock = ManualClock::at(0);
        let mut report = NodeReport::new("/unwrap");
        let mut levels = Vec::new();
        for bad in [0, 2, 0, 1] {
            add(&mut report.bad, "/modulo", bad);
            assert!(diagnostics.is_due(&clock));
            diagnostics.publish(&clock, &report, &Idle, (true, None));
            assert!(!diagnostics.is_due(&clock), "once a second");
            clock.set(clock.now_ns() + Duration::from_secs(1).as_nanos() as u64);
            let Ok(Incoming::Message(Message::Diagnostics(array))) = arrived.try_recv() else {
                panic!("a message on the remapped topic")
            };
            levels.push(array.status[0].level);
        }
        let [ok, warn] = [DiagnosticStatus::OK, DiagnosticStatus::WARN];
        assert_eq!(levels, [ok, warn, ok, warn]);
    }
}
