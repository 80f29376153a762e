//! [`Diagnostics`]: publishes the counts and the durations of the stages of a node on `/diagnostics`, once a second; and
//! [`StateTopic`]: publishes the values that a node uses on `~/state`, when they change.

use std::rc::Rc;
use std::sync::Arc;

use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::std_msgs::{Header, Time};

use crate::clock::Clock;
use crate::graph::{Qos, Topic};
use crate::message::{Message, MessageKind};
use crate::node::Node;
use crate::report::{NodeReport, quantile};
use crate::transport::Publisher;

const PERIOD_NS: u64 = 1_000_000_000;

/// The `/diagnostics` publisher of one node.
pub struct Diagnostics {
    publisher: Rc<dyn Publisher>,
    due: u64,
    /// Messages that had been skipped when the last message was published.
    bad: u64,
}

impl Diagnostics {
    /// Returns the topic. A node that publishes on it as well shares its publisher with its driver.
    pub fn topic() -> Topic {
        Topic::new("/diagnostics", MessageKind::Diagnostics)
    }

    /// Publishes with `publisher`.
    pub fn new(publisher: Rc<dyn Publisher>) -> Self {
        Self { publisher, due: 0, bad: 0 }
    }

    /// Returns whether a second has passed since the last message, and the topic has a reader.
    pub fn is_due(&self, clock: &dyn Clock) -> bool {
        clock.ticks_ns() >= self.due && self.publisher.wanted()
    }

    /// Publishes `report`. The level is WARN when messages were skipped since the last time.
    pub fn publish(&mut self, clock: &dyn Clock, report: &NodeReport, node: &dyn Node) {
        self.due = clock.ticks_ns() + PERIOD_NS;
        let bad = report.bad.values().sum();
        let skipped = bad - std::mem::replace(&mut self.bad, bad);
        let message = Message::Diagnostics(Arc::new(describe(clock.now_ns(), report, node, skipped)));
        if let Err(why) = self.publisher.put(&message) {
            // A warning each second about the same fault would hide all others.
            tracing::debug!("{why}");
        }
    }
}

/// Returns the report as a diagnostics message.
fn describe(now_ns: u64, report: &NodeReport, node: &dyn Node, skipped: u64) -> DiagnosticArray {
    let mut values = Vec::new();
    // Viewers of diagnostics show these pairs as they are, so the units stand in the keys.
    let mut say = |key: String, value: String| values.push(KeyValue { key, value });
    for (key, value) in node.status() {
        say(key.to_owned(), value);
    }
    for (what, counts) in [
        ("received", &report.received),
        ("published", &report.published),
        ("replaced", &report.replaced),
        ("lost", &report.lost),
        ("bad", &report.bad),
    ] {
        for (topic, count) in counts {
            say(format!("{what} {topic}"), count.to_string());
        }
    }
    for (stage, histogram) in &report.stages {
        for (name, q) in [("p50", 0.5), ("p99", 0.99)] {
            if let Some(us) = quantile(histogram, q) {
                say(format!("{stage} {name} ms"), format!("{:.3}", us as f64 / 1000.0));
            }
        }
    }
    let (level, text) = match skipped {
        0 => (DiagnosticStatus::OK, "running".to_owned()),
        _ => (DiagnosticStatus::WARN, format!("{skipped} bad messages were skipped")),
    };
    array(Time::from_ns(now_ns), report.node.trim_start_matches('/').to_owned(), level, text, values)
}

/// Returns a message with one status. Names of statuses have no leading slash, as those of `diagnostic_updater`.
fn array(stamp: Time, name: String, level: u8, message: String, values: Vec<KeyValue>) -> DiagnosticArray {
    let status = DiagnosticStatus { level, name, message, hardware_id: String::new(), values };
    DiagnosticArray { header: Header { stamp, frame_id: String::new() }, status: vec![status] }
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
    /// `stream` is the name of the image stream that it answers.
    pub fn tell(&mut self, stamp: Time, name: &str, node: &dyn Node, stream: Option<&str>) {
        let stream = stream.map(|stream| ("stream", stream.to_owned()));
        let state: Vec<_> = stream.into_iter().chain(node.state()).collect();
        if self.last.as_ref() == Some(&state) {
            return;
        }
        let value = |(key, value): &(&str, String)| KeyValue { key: (*key).to_owned(), value: value.clone() };
        let (name, values) =
            (format!("{}: state", name.trim_start_matches('/')), state.iter().map(value).collect());
        let message = array(stamp, name, DiagnosticStatus::OK, "in use".to_owned(), values);
        if let Err(why) = self.publisher.put(&Message::Diagnostics(Arc::new(message))) {
            tracing::warn!("{why}");
        }
        self.last = Some(state);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;
    use std::time::Duration;

    use super::*;
    use crate::clock::ManualClock;
    use crate::graph::NodeName;
    use crate::node::{Context, Flow, StepError, Trigger};
    use crate::parameter::{ParameterError, Parameters};
    use crate::report::add;
    use crate::transport::local::LocalTransport;
    use crate::transport::{Address, Incoming, Transport};

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
    fn the_topic_is_remapped_and_a_warning_ends_with_its_cause() {
        let transport = LocalTransport::default();
        let remaps = [("/diagnostics".to_owned(), "/health".to_owned())];
        let node_name = NodeName::new("unwrap", "/", &remaps).expect("names");
        let (sender, arrived) = channel();
        let deliver = Box::new(move |incoming| sender.send(incoming).expect("the test listens"));
        let address = Address::resolve(&node_name, &Diagnostics::topic()).expect("a name");
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
            diagnostics.publish(&clock, &report, &Idle);
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
