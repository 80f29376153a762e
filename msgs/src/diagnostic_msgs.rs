//! `diagnostic_msgs`: how the nodes are.

use serde::{Deserialize, Serialize};

use crate::interface::interfaces;
use crate::std_msgs::Header;

/// `diagnostic_msgs/msg/KeyValue`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeyValue {
    /// What is measured, with its unit.
    pub key: String,
    /// The measurement.
    pub value: String,
}

/// `diagnostic_msgs/msg/DiagnosticStatus`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiagnosticStatus {
    /// [`DiagnosticStatus::OK`], `WARN`, `ERROR` or `STALE`.
    pub level: u8,
    /// Node and part, such as `detector: inference`.
    pub name: String,
    /// One line for a person.
    pub message: String,
    /// What it runs on.
    pub hardware_id: String,
    /// Measurements.
    pub values: Vec<KeyValue>,
}

impl DiagnosticStatus {
    /// All is well.
    pub const OK: u8 = 0;
    /// It works, but somebody should look.
    pub const WARN: u8 = 1;
    /// It does not work.
    pub const ERROR: u8 = 2;
    /// Nothing was heard for too long.
    pub const STALE: u8 = 3;
}

/// `diagnostic_msgs/msg/DiagnosticArray`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiagnosticArray {
    /// When it was gathered.
    pub header: Header,
    /// One entry a part.
    pub status: Vec<DiagnosticStatus>,
}

interfaces! {
    KeyValue = "diagnostic_msgs/msg/KeyValue",
    DiagnosticStatus = "diagnostic_msgs/msg/DiagnosticStatus",
    DiagnosticArray = "diagnostic_msgs/msg/DiagnosticArray",
}
