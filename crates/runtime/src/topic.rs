//! [`Topic`]: a topic that a node reads or writes, as the node declares it, and its [`Address`], as the graph has it.

use std::fmt;

use crate::message::MessageKind;
use crate::name::{NameError, NodeName};

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
            // They stay the same for many frames, and late readers need them, too.
            MessageKind::VisionInfo | MessageKind::LabelInfo => Self::Latched,
            MessageKind::ParameterEvent => Self::Events,
            MessageKind::Log => Self::Logs,
            // As `rclcpp::ClockQoS`: the newest time, best effort.
            MessageKind::Clock => Self::Clock,
        }
    }
}

/// Whether samples are sent again until they have come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reliability {
    /// Lost samples are sent again.
    Reliable,
    /// Lost samples are not sent again.
    BestEffort,
}

/// The samples that a late reader gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Durability {
    /// The last samples from before it came.
    TransientLocal,
    /// A late reader gets only new samples.
    Volatile,
}

/// The quality of service of an endpoint: the policies that decide how it is carried, and whether two fit together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Profile {
    /// Code 1 or, as here, 2; reliable when not given.
    pub reliability: Reliability,
    /// Code 1 or, as here, 2; volatile when not given.
    pub durability: Durability,
    /// Samples that are kept; all of them is `usize::MAX`, 42 when not given.
    pub depth: usize,
}

/// Depth of a token without one.
const DEFAULT_DEPTH: usize = 42;

impl fmt::Display for Profile {
    /// Writes the form that tokens carry.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let reliability = if self.reliability == Reliability::BestEffort { "2" } else { "" };
        let durability = if self.durability == Durability::TransientLocal { "1" } else { "" };
        let history = match self.depth {
            usize::MAX => "2,".to_owned(),
            DEFAULT_DEPTH => ",".to_owned(),
            depth => format!(",{depth}"),
        };
        write!(f, "{reliability}:{durability}:{history}:,:,:,,")
    }
}

impl Profile {
    /// Reads `<reliability>:<durability>:<history>,<depth>:...`. Other fields get the defaults of rmw_zenoh.
    pub fn parse(text: &str) -> Self {
        let mut fields = text.split(':');
        let mut field = || fields.next().unwrap_or_default();
        let (reliability, durability, history) = (field(), field(), field());
        let (history, depth) = history.split_once(',').unwrap_or((history, ""));
        Self {
            reliability: if reliability == "2" { Reliability::BestEffort } else { Reliability::Reliable },
            durability: if durability == "1" { Durability::TransientLocal } else { Durability::Volatile },
            // History 2 keeps all samples, and its depth has no meaning.
            depth: if history == "2" { usize::MAX } else { depth.parse().unwrap_or(DEFAULT_DEPTH) },
        }
    }
}

/// The compressed variant of an image topic NAME, NAME/compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ImageCompression {
    /// There is none.
    None,
    /// PNG only: the values must stay as they are, such as those of modulo images.
    Lossless,
    /// JPEG, or PNG where it is asked for and for images of more than 8 bits.
    Any,
}

/// Topic of the status of each recovered frame, relative to the namespace of the `unwrap` node. It has the stamp of the frame,
/// and the value `trusted` where the method makes a claim.
pub const RECOVERY_TOPIC: &str = "recovery";

/// A topic that a node reads or writes.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Topic {
    /// ROS name, relative (`modulo`), private (`~/detections`) or absolute (`/camera/image_raw`), not resolved yet.
    pub name: String,
    /// Kind of the messages.
    pub kind: MessageKind,
    /// Quality of service.
    pub qos: Qos,
    /// Its compressed variant.
    pub compression: ImageCompression,
}

impl Topic {
    /// Creates a topic with the quality of service usual for its kind. A topic of images has a compressed variant.
    pub fn new(name: impl Into<String>, kind: MessageKind) -> Self {
        let compression =
            if kind == MessageKind::Image { ImageCompression::Any } else { ImageCompression::None };
        Self { name: name.into(), kind, qos: Qos::usual(kind), compression }
    }
}

/// Returns the topic of the status of all nodes. A node that publishes on it as well shares its publisher with its driver.
pub fn diagnostics() -> Topic {
    Topic::new("/diagnostics", MessageKind::Diagnostics)
}

/// Returns the topic with the camera info of the images on `topic`: `camera_info` in its namespace, as in ROS 2.
pub fn camera_info_topic(topic: &str) -> String {
    let namespace = topic.rsplit_once('/').map(|(namespace, _)| format!("{namespace}/"));
    format!("{}camera_info", namespace.unwrap_or_default())
}

/// A topic as the graph sees it: absolute and remapped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Absolute name of the topic.
    pub topic: String,
    /// Kind of the messages.
    pub kind: MessageKind,
    /// Quality of service.
    pub qos: Qos,
    /// The profile that a user has given in place of that of `qos`.
    pub profile: Option<Profile>,
}

impl Address {
    /// Returns the address of `topic` for the node `node_name`: its name made absolute and remapped.
    ///
    /// # Errors
    /// [`NameError`] when the name is not a ROS name.
    pub fn resolve(node_name: &NodeName, topic: &Topic) -> Result<Self, NameError> {
        Ok(Self { topic: node_name.resolve(&topic.name)?, kind: topic.kind, qos: topic.qos, profile: None })
    }
}

/// Returns the addresses of `topics` for the node `node_name`, in the same order.
///
/// # Errors
/// [`NameError`] of the first topic without a ROS name.
pub fn addresses(node_name: &NodeName, topics: &[Topic]) -> Result<Vec<Address>, NameError> {
    topics.iter().map(|topic| Address::resolve(node_name, topic)).collect()
}
