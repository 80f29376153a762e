//! ROS 2 messages as plain serde structs: CDR, type hashes, `Image` <-> `Frame`.
//!
//! One module a ROS package, with ROS's own field names and order. Nothing here
//! opens a connection, reads a file or a clock, or needs a ROS installation.

mod array;
pub mod builtin;
mod bytes;
pub mod diagnostic_msgs;
pub mod geometry_msgs;
pub mod interface;
pub mod rcl_interfaces;
pub mod rosgraph_msgs;
pub mod sensor_msgs;
pub mod service_msgs;
pub mod std_msgs;
pub mod std_srvs;
pub mod type_description_interfaces;
pub mod vision_msgs;
