//! Once a second, each node tells on `/diagnostics` what it received, sent,
//! lost and how long its stages take.

use std::sync::Arc;

use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::std_msgs::{Header, Time};

use crate::clock::Clock;
use crate::message::{Message, MessageKind};
use crate::name::Place;
use crate::node::Node;
use crate::report::{NodeReport, quantile};
use crate::topic::Qos;
use crate::transport::{Address, Outlet, Transport, TransportError};

const PERIOD_NS: u64 = 1_000_000_000;

/// The `/diagnostics` publisher of one node.
pub struct Diagnostics {
    outlet: Box<dyn Outlet>,
    due: u64,
}

impl Diagnostics {
    /// Advertises `/diagnostics` for the node at `place`.
    ///
    /// # Errors
    /// [`TransportError`] when the carrier refuses.
    pub fn new(place: &Place, transport: &dyn Transport) -> Result<Self, TransportError> {
        let address =
            Address { topic: "/diagnostics".into(), kind: MessageKind::Diagnostics, qos: Qos::Results };
        Ok(Self { outlet: transport.advertise(place, &address)?, due: 0 })
    }

    /// Publishes `report` when a second has passed since the last time and
    /// somebody reads it.
    pub fn publish_when_due(&mut self, clock: &dyn Clock, report: &NodeReport, node: &dyn Node) {
        let now = clock.ticks_ns();
        if now < self.due || !self.outlet.wanted() {
            return;
        }
        self.due = now + PERIOD_NS;
        let message = Message::Diagnostics(Arc::new(describe(clock.now_ns(), report, node)));
        if let Err(why) = self.outlet.put(&message) {
            tracing::debug!("{why}");
        }
    }
}

/// The report as a diagnostics message.
pub fn describe(now_ns: u64, report: &NodeReport, node: &dyn Node) -> DiagnosticArray {
    let mut values = Vec::new();
    let mut say = |key: String, value: String| values.push(KeyValue { key, value });
    for (key, value) in node.facts() {
        say(key.to_owned(), value);
    }
    for (what, counts) in [
        ("received", &report.received),
        ("published", &report.published),
        ("dropped", &report.dropped),
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
    let troubled = !report.bad.is_empty();
    let status = DiagnosticStatus {
        level: if troubled { DiagnosticStatus::WARN } else { DiagnosticStatus::OK },
        name: report.node.trim_start_matches('/').to_owned(),
        message: if troubled { "bad messages were skipped".into() } else { "running".into() },
        hardware_id: String::new(),
        values,
    };
    let header = Header { stamp: Time::from_ns(now_ns), frame_id: String::new() };
    DiagnosticArray { header, status: vec![status] }
}
