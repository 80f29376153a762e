//! [`Diagnostics`]: publishes the counts and the durations of the stages of a node on `/diagnostics`, once a second.

use std::rc::Rc;
use std::sync::Arc;

use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::std_msgs::{Header, Time};

use crate::clock::Clock;
use crate::graph::Topic;
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
    let status = DiagnosticStatus {
        level: if skipped > 0 { DiagnosticStatus::WARN } else { DiagnosticStatus::OK },
        // Names of statuses have no leading slash, as those of `diagnostic_updater`.
        name: report.node.trim_start_matches('/').to_owned(),
        message: if skipped > 0 { format!("{skipped} bad messages were skipped") } else { "running".into() },
        hardware_id: String::new(),
        values,
    };
    let header = Header { stamp: Time::from_ns(now_ns), frame_id: String::new() };
    DiagnosticArray { header, status: vec![status] }
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
