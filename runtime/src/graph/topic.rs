//! Topic names and the quality of service that goes with each kind of message.

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
