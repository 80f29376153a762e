//! `std_msgs`: the header that every stamped message carries.

pub use crate::builtin::Time;
use crate::interface::messages;

messages! {
    Header = "std_msgs/msg/Header" {
        /// Time at which the data was acquired.
        stamp: Time,
        /// Name of the coordinate frame, such as `camera`.
        frame_id: std::string::String,
    }
    String = "std_msgs/msg/String" {
        /// The text.
        data: std::string::String,
    }
}
