//! ROS 2 messages as plain serde structs: CDR, type hashes, `Image` <-> `Frame`.
//!
//! Each ROS package has a module, with the field names and the order of ROS. Nothing here opens a connection, reads a
//! file or a clock, or needs a ROS installation.

pub mod cdr;
pub mod definition;
mod detection;
pub mod dynamic;
pub mod image;
pub mod interface;
pub mod rcl_interfaces;
pub mod rihs;
mod services;
mod topics;
mod yuv;

pub use crate::interface::{Interface, dds_name, ros_name, ros2msg};
pub use crate::rihs::{type_hash, type_hash_of_schema};
pub use crate::services::{rosbag2_interfaces, service_msgs, std_srvs, type_description_interfaces};
pub use crate::topics::{
    builtin, diagnostic_msgs, geometry_msgs, rosgraph_msgs, sensor_msgs, std_msgs, vision_msgs,
};
