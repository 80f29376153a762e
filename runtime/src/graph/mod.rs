//! Everything that the ROS graph sees of a node: its name, its topics and services, `/diagnostics`, `/rosout`, `/clock`,
//! the level of its log and the descriptions of its types; and the graph itself, with the endpoints that do not fit together.

pub mod diagnostics;
pub mod discovery;
pub mod logger;
pub mod name;
pub mod node_time;
pub mod rosout;
pub mod type_description;

pub use discovery::Graph;
pub use name::{NameError, NodeName};

use crate::message::MessageKind;

/// Quality of service of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Qos {
    /// ROS 2 "sensor data": best effort, keep last 5. A slow reader loses old images instead of stopping the camera.
    Images,
    /// ROS 2 default: reliable, keep last 10.
    Results,
    /// Reliable and transient local, keep last 1: a late reader still gets it.
    Latched,
    /// `/clock`: best effort, keep last 1.
    Clock,
    /// `/parameter_events`: reliable, keep last 1000.
    Events,
    /// `/rosout`: reliable, keep last 1000, transient local, forgotten after 10 s.
    Logs,
}

impl Qos {
    /// All profiles.
    pub const ALL: [Self; 6] =
        [Self::Images, Self::Results, Self::Latched, Self::Clock, Self::Events, Self::Logs];

    /// Returns the quality of service usual for messages of `kind`.
    pub fn usual(kind: MessageKind) -> Self {
        match kind {
            MessageKind::Image | MessageKind::CompressedImage | MessageKind::CameraInfo => Self::Images,
            MessageKind::Detections | MessageKind::Diagnostics => Self::Results,
            MessageKind::ParameterEvent => Self::Events,
            MessageKind::Log => Self::Logs,
            // As `rclcpp::ClockQoS`: the newest time, best effort.
            MessageKind::Clock => Self::Clock,
        }
    }
}

/// A topic that a node reads or writes.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Topic {
    /// ROS name: relative (`modulo`), private (`~/detections`) or absolute (`/camera/image_raw`). Resolved and remapped
    /// by the driver.
    pub name: String,
    /// Kind of the messages.
    pub kind: MessageKind,
    /// Quality of service.
    pub qos: Qos,
}

impl Topic {
    /// Creates a topic with the quality of service usual for its kind.
    pub fn new(name: impl Into<String>, kind: MessageKind) -> Self {
        Self { name: name.into(), kind, qos: Qos::usual(kind) }
    }
}

/// Declares the services of a node: each variant has the name of its ROS type in `package`, and a name below the name
/// of the node.
///
/// ```
/// modulo_runtime::services! {
///     /// The services of a lamp.
///     pub enum LampService in "std_srvs" {
///         SetBool = "set_light",
///     }
/// }
/// assert_eq!(LampService::SetBool.name_and_type(), ("set_light", "std_srvs/srv/SetBool"));
/// ```
#[macro_export]
macro_rules! services {
    ($(#[$about:meta])* pub enum $services:ident in $package:literal { $($type:ident = $name:literal,)+ }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $services {
            $(#[doc = concat!("`~/", $name, "`")] $type,)+
        }

        impl $services {
            /// All services, in the order of their declaration.
            pub const ALL: &[Self] = &[$(Self::$type),+];

            /// Returns the name of the service below the name of its node, and its ROS type.
            pub fn name_and_type(self) -> (&'static str, &'static str) {
                match self { $(Self::$type => ($name, concat!($package, "/srv/", stringify!($type)))),+ }
            }
        }
    };
}
