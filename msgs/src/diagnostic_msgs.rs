//! `diagnostic_msgs`: the condition of the nodes.

use crate::interface::messages;
use crate::std_msgs::Header;

messages! {
    KeyValue = "diagnostic_msgs/msg/KeyValue" {
        /// Name of the measurement, with its unit.
        key: String,
        /// The measurement.
        value: String,
    }
    DiagnosticStatus = "diagnostic_msgs/msg/DiagnosticStatus" {
        /// [`DiagnosticStatus::OK`], `WARN`, `ERROR` or `STALE`.
        level: u8,
        /// Node and component, such as `detector: inference`.
        name: String,
        /// One line for a person.
        message: String,
        /// The hardware that the component runs on.
        hardware_id: String,
        /// Measurements.
        values: Vec<KeyValue>,
    }
    DiagnosticArray = "diagnostic_msgs/msg/DiagnosticArray" {
        /// The time at which the values were gathered.
        header: Header,
        /// One entry for each component.
        status: Vec<DiagnosticStatus>,
    }
}

impl DiagnosticStatus {
    /// The component works.
    pub const OK: u8 = 0;
    /// The component works, but a person should look at it.
    pub const WARN: u8 = 1;
    /// The component does not work.
    pub const ERROR: u8 = 2;
    /// The component has sent no data for too long.
    pub const STALE: u8 = 3;
}
