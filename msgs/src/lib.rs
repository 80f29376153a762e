//! ROS 2 messages as plain serde structs: CDR, type hashes, `Image` <-> `Frame`.
//!
//! Each ROS package has a module, with the field names and the order of ROS. Nothing here opens a connection, reads a
//! file or a clock, or needs a ROS installation.

mod array;
pub mod builtin;
mod bytes;
pub mod cdr;
pub mod definition;
mod detection;
pub mod diagnostic_msgs;
pub mod dynamic;
pub mod geometry_msgs;
pub mod image;
pub mod interface;
pub mod rcl_interfaces;
pub mod rihs;
pub mod rosbag2_interfaces;
pub mod rosgraph_msgs;
pub mod schema;
pub mod sensor_msgs;
pub mod service_msgs;
pub mod std_msgs;
pub mod std_srvs;
pub mod type_description_interfaces;
pub mod vision_msgs;

pub use crate::interface::Interface;
pub use crate::rihs::{type_hash, type_hash_of_schema};
pub use crate::schema::{dds_name, ros_name, ros2msg};
