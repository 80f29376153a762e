//! ROS 2 messages as plain serde structs: CDR, type hashes, `Image` <-> `Frame`.
//!
//! Each ROS package has a module, with the field names and the order of ROS. Nothing here opens a connection, reads a
//! file or a clock, or needs a ROS installation.

/// Declares the messages of one ROS package: `Message = "package/msg/Message" { fields }`, the fields as public and in
/// the order of the definition. A message without braces has no fields.
macro_rules! messages {
    (@struct $(#[$about:meta])* $message:ident $name:literal) => {
        #[doc = concat!("`", $name, "`")]
        $(#[$about])*
        #[derive(Clone, Debug, Default, PartialEq, ::serde::Serialize, ::serde::Deserialize)]
        // ROS gives a message without fields one byte: the field `structure_needs_at_least_one_member`.
        #[serde(from = "u8", into = "u8")]
        pub struct $message;

        impl From<u8> for $message {
            fn from(_: u8) -> Self {
                Self
            }
        }

        impl From<$message> for u8 {
            fn from(_: $message) -> Self {
                0
            }
        }
    };
    (@struct $(#[$about:meta])* $message:ident $name:literal
        $($(#[$help:meta])* $field:ident: $type:ty),+ $(,)?
    ) => {
        #[doc = concat!("`", $name, "`")]
        ///
        $(#[$about])*
        #[derive(Clone, Debug, Default, PartialEq, ::serde::Serialize, ::serde::Deserialize)]
        #[allow(missing_docs, reason = "a field without a text is what its name says")]
        pub struct $message {
            $($(#[$help])* pub $field: $type,)+
        }
    };
    ($($(#[$about:meta])* $message:ident = $name:literal $({ $($fields:tt)+ })?)+) => {$(
        messages!(@struct $(#[$about])* $message $name $($($fields)+)?);

        impl $crate::Interface for $message {
            const NAME: &'static str = $name;
        }
    )+};
}

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

pub use crate::interface::{dds_name, ros_name, ros2msg};
pub use crate::rihs::{type_hash, type_hash_of_schema};
pub use crate::services::{rosbag2_interfaces, service_msgs, std_srvs, type_description_interfaces};
pub use crate::topics::{
    builtin, diagnostic_msgs, geometry_msgs, rosgraph_msgs, sensor_msgs, std_msgs, vision_msgs,
};

/// A message with a ROS name.
pub trait Interface {
    /// Name of the type, such as `sensor_msgs/msg/Image` or `std_srvs/srv/SetBool_Request`.
    const NAME: &'static str;
}
