//! `std_msgs` and `builtin_interfaces`.

use serde::{Deserialize, Serialize};

/// `builtin_interfaces/msg/Time`: a point in time since the Unix epoch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Time {
    /// Whole seconds.
    pub sec: i32,
    /// Nanoseconds of the second, 0 to 999,999,999.
    pub nanosec: u32,
}

/// `std_msgs/msg/Header`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// When the data was acquired.
    pub stamp: Time,
    /// Coordinate frame, such as `camera`.
    pub frame_id: String,
}
