//! `rosgraph_msgs`: simulated time.

use serde::{Deserialize, Serialize};

use crate::builtin::Time;
use crate::interface::interfaces;

/// `rosgraph_msgs/msg/Clock`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Clock {
    /// The time now.
    pub clock: Time,
}

interfaces! {
    Clock = "rosgraph_msgs/msg/Clock",
}
