//! `diagnostic_msgs`.

use serde::{Deserialize, Serialize};

use crate::std_msgs::Header;

/// `diagnostic_msgs/msg/DiagnosticArray`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DiagnosticArray {
    /// When it was gathered.
    pub header: Header,
}
