//! [`Message`]: what travels between steps, shared by `Arc` inside a process
//! and as CDR between processes.

use std::sync::Arc;

use modulo_core::Frame;
use modulo_msgs::cdr;
use modulo_msgs::diagnostic_msgs::DiagnosticArray;
use modulo_msgs::rcl_interfaces::{Log, ParameterEvent};
use modulo_msgs::rosgraph_msgs::Clock;
use modulo_msgs::sensor_msgs::{CameraInfo, CompressedImage, Image};
use modulo_msgs::std_msgs::{Header, Time};
use modulo_msgs::vision_msgs::Detection2DArray;

/// An image with the header of the exposure it came from.
#[derive(Clone, Debug, PartialEq)]
pub struct StampedFrame {
    /// Stamp and frame of the exposure; copied, never made anew, by every node
    /// behind the camera.
    pub header: Header,
    /// The pixels.
    pub frame: Frame,
}

/// The kinds of message that the suite's nodes exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MessageKind {
    /// `sensor_msgs/msg/Image`
    Image,
    /// `sensor_msgs/msg/CompressedImage`
    CompressedImage,
    /// `sensor_msgs/msg/CameraInfo`
    CameraInfo,
    /// `vision_msgs/msg/Detection2DArray`
    Detections,
    /// `diagnostic_msgs/msg/DiagnosticArray`
    Diagnostics,
    /// `rcl_interfaces/msg/ParameterEvent`
    ParameterEvent,
    /// `rcl_interfaces/msg/Log`
    Log,
    /// `rosgraph_msgs/msg/Clock`
    Clock,
}

/// One message, cheap to clone.
#[derive(Clone, Debug)]
pub enum Message {
    /// `sensor_msgs/msg/Image`
    Image(Arc<StampedFrame>),
    /// `sensor_msgs/msg/CompressedImage`
    CompressedImage(Arc<CompressedImage>),
    /// `sensor_msgs/msg/CameraInfo`
    CameraInfo(Arc<CameraInfo>),
    /// `vision_msgs/msg/Detection2DArray`
    Detections(Arc<Detection2DArray>),
    /// `diagnostic_msgs/msg/DiagnosticArray`
    Diagnostics(Arc<DiagnosticArray>),
    /// `rcl_interfaces/msg/ParameterEvent`
    ParameterEvent(Arc<ParameterEvent>),
    /// `rcl_interfaces/msg/Log`
    Log(Arc<Log>),
    /// `rosgraph_msgs/msg/Clock`
    Clock(Clock),
}

impl Message {
    /// Which kind this is.
    pub fn kind(&self) -> MessageKind {
        match self {
            Self::Image(_) => MessageKind::Image,
            Self::CompressedImage(_) => MessageKind::CompressedImage,
            Self::CameraInfo(_) => MessageKind::CameraInfo,
            Self::Detections(_) => MessageKind::Detections,
            Self::Diagnostics(_) => MessageKind::Diagnostics,
            Self::ParameterEvent(_) => MessageKind::ParameterEvent,
            Self::Log(_) => MessageKind::Log,
            Self::Clock(_) => MessageKind::Clock,
        }
    }

    /// When what it tells of was.
    pub fn stamp(&self) -> Time {
        match self {
            Self::Image(image) => image.header.stamp,
            Self::CompressedImage(image) => image.header.stamp,
            Self::CameraInfo(info) => info.header.stamp,
            Self::Detections(array) => array.header.stamp,
            Self::Diagnostics(array) => array.header.stamp,
            Self::ParameterEvent(event) => event.stamp,
            Self::Log(log) => log.stamp,
            Self::Clock(clock) => clock.clock,
        }
    }

    /// Sets the stamp that [`Message::stamp`] returns.
    pub fn set_stamp(&mut self, stamp: Time) {
        *match self {
            Self::Image(image) => &mut Arc::make_mut(image).header.stamp,
            Self::CompressedImage(image) => &mut Arc::make_mut(image).header.stamp,
            Self::CameraInfo(info) => &mut Arc::make_mut(info).header.stamp,
            Self::Detections(array) => &mut Arc::make_mut(array).header.stamp,
            Self::Diagnostics(array) => &mut Arc::make_mut(array).header.stamp,
            Self::ParameterEvent(event) => &mut Arc::make_mut(event).stamp,
            Self::Log(log) => &mut Arc::make_mut(log).stamp,
            Self::Clock(clock) => &mut clock.clock,
        } = stamp;
    }
}

/// Why bytes are not the message they should be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("not a readable {kind}: {why}")]
pub struct DecodeError {
    /// ROS name of the type that was expected.
    pub kind: &'static str,
    /// What is wrong, with the numbers.
    pub why: String,
}

impl MessageKind {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Image,
        Self::CompressedImage,
        Self::CameraInfo,
        Self::Detections,
        Self::Diagnostics,
        Self::ParameterEvent,
        Self::Log,
        Self::Clock,
    ];

    /// ROS name of the type.
    pub fn type_name(self) -> &'static str {
        match self {
            Self::Image => "sensor_msgs/msg/Image",
            Self::CompressedImage => "sensor_msgs/msg/CompressedImage",
            Self::CameraInfo => "sensor_msgs/msg/CameraInfo",
            Self::Detections => "vision_msgs/msg/Detection2DArray",
            Self::Diagnostics => "diagnostic_msgs/msg/DiagnosticArray",
            Self::ParameterEvent => "rcl_interfaces/msg/ParameterEvent",
            Self::Log => "rcl_interfaces/msg/Log",
            Self::Clock => "rosgraph_msgs/msg/Clock",
        }
    }

    /// The kind of this ROS type, if the suite knows it.
    pub fn from_type_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.type_name() == name)
    }

    /// `RIHS01_...` of the type.
    pub fn type_hash(self) -> String {
        modulo_msgs::type_hash(self.type_name()).expect("every kind of message is defined in modulo_msgs")
    }
}

impl Message {
    /// CDR with its encapsulation header.
    ///
    /// # Errors
    /// [`cdr::CdrError`] when a string or sequence is longer than CDR can say.
    pub fn encode(&self) -> Result<Vec<u8>, cdr::CdrError> {
        match self {
            Self::Image(image) => modulo_msgs::image::encode_frame(&image.header, &image.frame),
            Self::CompressedImage(message) => cdr::to_vec(&**message),
            Self::CameraInfo(message) => cdr::to_vec(&**message),
            Self::Detections(message) => cdr::to_vec(&**message),
            Self::Diagnostics(message) => cdr::to_vec(&**message),
            Self::ParameterEvent(message) => cdr::to_vec(&**message),
            Self::Log(message) => cdr::to_vec(&**message),
            Self::Clock(message) => cdr::to_vec(message),
        }
    }

    /// Reads CDR as a message of `kind`.
    ///
    /// # Errors
    /// [`DecodeError`] with what is wrong with the bytes.
    pub fn decode(kind: MessageKind, bytes: &[u8]) -> Result<Self, DecodeError> {
        let bad = |why: String| DecodeError { kind: kind.type_name(), why };
        Ok(match kind {
            MessageKind::Image => {
                let image: Image = cdr::from_slice(bytes).map_err(|e| bad(e.to_string()))?;
                let header = image.header.clone();
                let frame = image.into_frame().map_err(|e| bad(e.to_string()))?;
                Self::Image(Arc::new(StampedFrame { header, frame }))
            }
            MessageKind::CompressedImage => Self::CompressedImage(parse(bytes).map_err(bad)?),
            MessageKind::CameraInfo => Self::CameraInfo(parse(bytes).map_err(bad)?),
            MessageKind::Detections => Self::Detections(parse(bytes).map_err(bad)?),
            MessageKind::Diagnostics => Self::Diagnostics(parse(bytes).map_err(bad)?),
            MessageKind::ParameterEvent => Self::ParameterEvent(parse(bytes).map_err(bad)?),
            MessageKind::Log => Self::Log(parse(bytes).map_err(bad)?),
            MessageKind::Clock => Self::Clock(cdr::from_slice(bytes).map_err(|e| bad(e.to_string()))?),
        })
    }
}

fn parse<T: serde::de::DeserializeOwned>(bytes: &[u8]) -> Result<Arc<T>, String> {
    cdr::from_slice(bytes).map(Arc::new).map_err(|e| e.to_string())
}
