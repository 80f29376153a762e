//! ROS 2 messages as plain serde structs: CDR, type hashes, `Image` <-> `Frame`.
//!
//! Each ROS package has a module, with the field names and the order of ROS: the build script makes it of the definitions in
//! `interfaces/`. It also has the types of other packages that its messages hold. Nothing here opens a connection, reads a file or a
//! clock, or needs a ROS installation.

/// Declares the modules of ROS packages.
macro_rules! packages {
    ($($(#[$about:meta])+ $package:ident)+) => {$(
        $(#[$about])+
        #[allow(missing_docs, reason = "a field without a text is what its name says")]
        pub mod $package {
            include!(concat!(env!("OUT_DIR"), "/", stringify!($package), ".rs"));
        }
    )+};
}

packages! {
    /// Points in time and durations.
    builtin_interfaces
    /// The condition of the nodes.
    diagnostic_msgs
    /// The pose that vision messages carry.
    geometry_msgs
    /// Parameters with their six services, log lines, and the services of the level of the log.
    rcl_interfaces
    /// The services that control a running player, as in ROS 2 Jazzy.
    rosbag2_interfaces
    /// Simulated time.
    rosgraph_msgs
    /// Images and camera calibrations.
    sensor_msgs
    /// The common fields of all service events.
    service_msgs
    /// The header that every stamped message carries, and a text.
    std_msgs
    /// The three standard services.
    std_srvs
    /// Descriptions of types as messages. The hash of a type is computed over its
    /// [`TypeDescription`](type_description_interfaces::TypeDescription).
    type_description_interfaces
    /// Detections. Boxes have a centre and a size in px of the original image.
    vision_msgs
}

pub mod cdr;
pub mod definition;
mod detection;
pub mod dynamic;
pub mod image;
pub mod interface;
mod methods;
pub mod rihs;
mod yuv;

pub use crate::interface::{dds_name, ros_name, ros2msg};
pub use crate::rihs::{type_hash, type_hash_of_schema};

/// A message with a ROS name.
pub trait Interface {
    /// Name of the type, such as `sensor_msgs/msg/Image` or `std_srvs/srv/SetBool_Request`.
    const NAME: &'static str;
}
