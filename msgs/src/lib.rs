//! ROS 2 messages as plain serde structs: CDR, type hashes, `Image` <-> `Frame`.

pub mod diagnostic_msgs;
pub mod sensor_msgs;
pub mod std_msgs;
pub mod vision_msgs;
