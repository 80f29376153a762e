//! The status of each recovered frame on `/diagnostics`, and its counts for the summary.
//!
//! This file judges nothing: the method used, its quality metrics and the trust are those of the method's report.

use std::collections::BTreeMap;

use modulo_core::unwrap::{QualityMetrics, Report, Trust};
use modulo_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use modulo_msgs::std_msgs::Header;

/// Number of frames for each method that was used, and number of trusted frames.
#[derive(Default)]
pub struct RecoveryCounts {
    rungs: BTreeMap<&'static str, u64>,
    trusted: u64,
}

impl RecoveryCounts {
    /// Counts one frame.
    pub fn count(&mut self, report: &Report) {
        *self.rungs.entry(report.method).or_default() += 1;
        self.trusted += u64::from(report.trust == Trust::Trusted);
    }

    /// `("rungs", "lines 58, gradient_tree 2")` and `("trusted", "58 of 60 frames")`; nothing before the first frame.
    pub fn status(&self) -> Vec<(&'static str, String)> {
        let frames: u64 = self.rungs.values().sum();
        if frames == 0 {
            return Vec::new();
        }
        let rungs: Vec<String> = self.rungs.iter().map(|(rung, count)| format!("{rung} {count}")).collect();
        vec![("rungs", rungs.join(", ")), ("trusted", format!("{} of {frames} frames", self.trusted))]
    }
}

/// Returns the status of one recovered frame, stamped as its image, under the name that ROS gives a status of the fully qualified `node`.
pub fn describe(node: &str, header: &Header, method: &str, report: &Report) -> DiagnosticArray {
    let (level, message) = match report.trust {
        Trust::Trusted => (DiagnosticStatus::OK, "trusted"),
        Trust::Contradicted => {
            (DiagnosticStatus::WARN, "not trusted: y departs from what the method assumes")
        }
        Trust::Unknown => (DiagnosticStatus::OK, "the method makes no claim"),
    };
    let mut values = vec![("method", method.to_owned()), ("rung", report.method.to_owned())];
    if let Some(trusted) = report.trust.claim() {
        values.push(("trusted", trusted.to_string()));
    }
    if let Some(QualityMetrics { residues, steep, consensus, clamped }) = report.quality {
        let share = |value: f32| format!("{value:.3e}");
        let shares =
            [("residues", residues), ("steep", steep), ("consensus", consensus), ("clamped", clamped)];
        values.extend(shares.map(|(name, value)| (name, share(value))));
    }
    let values = values.into_iter().map(|(key, value)| KeyValue { key: key.to_owned(), value }).collect();
    let status = DiagnosticStatus {
        level,
        name: format!("{}: recovery", node.trim_start_matches('/')),
        message: message.into(),
        hardware_id: String::new(),
        values,
    };
    DiagnosticArray { header: header.clone(), status: vec![status] }
}
