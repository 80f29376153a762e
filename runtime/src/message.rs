//! [`Message`]: what travels between steps, shared by `Arc` inside a process
//! and as CDR between processes.

use std::sync::Arc;

use modulo_core::Frame;
use modulo_msgs::diagnostic_msgs::DiagnosticArray;
use modulo_msgs::sensor_msgs::{CameraInfo, CompressedImage};
use modulo_msgs::std_msgs::Header;
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
        }
    }
}
