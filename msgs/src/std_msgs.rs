//! `std_msgs`: the header that every stamped message carries.

use serde::{Deserialize, Serialize};

pub use crate::builtin::Time;
use crate::interface::interfaces;

/// `std_msgs/msg/Header`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// When the data was acquired.
    pub stamp: Time,
    /// Coordinate frame, such as `camera`.
    pub frame_id: std::string::String,
}

/// `std_msgs/msg/String`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct String {
    /// The text.
    pub data: std::string::String,
}

interfaces! {
    Header = "std_msgs/msg/Header",
    String = "std_msgs/msg/String",
}
