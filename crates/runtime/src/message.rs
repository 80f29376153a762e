//! [`Message`]: the messages that travel between steps, shared by `Arc` inside a process and as CDR between processes.

use std::sync::Arc;

use modulo_core::Frame;
use modulo_msgs::cdr;
use modulo_msgs::diagnostic_msgs::DiagnosticArray;
use modulo_msgs::rcl_interfaces::{Log, ParameterEvent};
use modulo_msgs::rosgraph_msgs::Clock;
use modulo_msgs::sensor_msgs::{CameraInfo, CompressedImage, Image};
use modulo_msgs::std_msgs::{Header, Time};
use modulo_msgs::vision_msgs::{Detection2DArray, LabelInfo, VisionInfo};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// An image with the header of its exposure.
#[derive(Clone, Debug, PartialEq)]
pub struct StampedFrame {
    /// Stamp and coordinate frame of the exposure. Every node behind the camera copies it unchanged.
    pub header: Header,
    /// The pixels.
    pub frame: Frame,
}

/// Declares the kinds of message from one table: variant, type, ROS name of the type, and the field with the stamp.
macro_rules! kinds {
    ($($kind:ident($type:ty) $name:literal $($stamp:ident).+;)+) => {
        /// The kinds of message that the nodes of the suite exchange.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum MessageKind {
            $(#[doc = concat!("`", $name, "`")] $kind,)+
        }

        /// One message, cheap to clone.
        #[derive(Clone, Debug)]
        pub enum Message {
            $(#[doc = concat!("`", $name, "`")] $kind(Arc<$type>),)+
        }

        $(impl From<$type> for Message {
            fn from(content: $type) -> Self {
                Self::$kind(Arc::new(content))
            }
        })+

        impl MessageKind {
            /// All kinds.
            pub const ALL: &[Self] = &[$(Self::$kind),+];

            /// Returns the ROS name of the type.
            pub fn type_name(self) -> &'static str {
                match self { $(Self::$kind => $name),+ }
            }
        }

        impl Message {
            /// Returns the kind of this message.
            pub fn kind(&self) -> MessageKind {
                match self { $(Self::$kind(_) => MessageKind::$kind),+ }
            }

            /// Returns the time that the message belongs to.
            pub fn stamp(&self) -> Time {
                match self { $(Self::$kind(message) => message.$($stamp).+),+ }
            }

            /// Sets the stamp that [`Message::stamp`] returns.
            pub fn set_stamp(&mut self, stamp: Time) {
                match self { $(Self::$kind(message) => Arc::make_mut(message).$($stamp).+ = stamp),+ }
            }

            /// Returns the message as CDR with its encapsulation header.
            ///
            /// # Errors
            /// [`cdr::CdrError`] when a string or sequence is too long for CDR.
            pub fn encode(&self) -> Result<Vec<u8>, cdr::CdrError> {
                match self { $(Self::$kind(message) => message.to_cdr()),+ }
            }

            /// Reads CDR as a message of `kind`.
            ///
            /// # Errors
            /// A description of the fault in the bytes.
            pub fn decode(kind: MessageKind, bytes: &[u8]) -> Result<Self, String> {
                let unreadable = |why: String| format!("not a readable {}: {why}", kind.type_name());
                Ok(match kind {
                    $(MessageKind::$kind => Self::$kind(Arc::new(CdrCodec::from_cdr(bytes).map_err(unreadable)?))),+
                })
            }
        }
    };
}

kinds! {
    Image(StampedFrame) "sensor_msgs/msg/Image" header.stamp;
    CompressedImage(CompressedImage) "sensor_msgs/msg/CompressedImage" header.stamp;
    CameraInfo(CameraInfo) "sensor_msgs/msg/CameraInfo" header.stamp;
    Detections(Detection2DArray) "vision_msgs/msg/Detection2DArray" header.stamp;
    VisionInfo(VisionInfo) "vision_msgs/msg/VisionInfo" header.stamp;
    LabelInfo(LabelInfo) "vision_msgs/msg/LabelInfo" header.stamp;
    Diagnostics(DiagnosticArray) "diagnostic_msgs/msg/DiagnosticArray" header.stamp;
    ParameterEvent(ParameterEvent) "rcl_interfaces/msg/ParameterEvent" stamp;
    Log(Log) "rcl_interfaces/msg/Log" stamp;
    Clock(Clock) "rosgraph_msgs/msg/Clock" clock;
}

/// The content of a message and its form as CDR.
trait CdrCodec: Sized {
    fn to_cdr(&self) -> Result<Vec<u8>, cdr::CdrError>;
    fn from_cdr(bytes: &[u8]) -> Result<Self, String>;
}

impl<T: Serialize + DeserializeOwned> CdrCodec for T {
    fn to_cdr(&self) -> Result<Vec<u8>, cdr::CdrError> {
        cdr::to_vec(self)
    }

    fn from_cdr(bytes: &[u8]) -> Result<Self, String> {
        cdr::from_slice(bytes).map_err(|why| why.to_string())
    }
}

impl CdrCodec for StampedFrame {
    fn to_cdr(&self) -> Result<Vec<u8>, cdr::CdrError> {
        modulo_msgs::image::encode_frame(&self.header, &self.frame)
    }

    fn from_cdr(bytes: &[u8]) -> Result<Self, String> {
        let image: Image = cdr::from_slice(bytes).map_err(|why| why.to_string())?;
        // The conversion into pixels consumes the message and leaves the header out.
        let header = image.header.clone();
        Ok(Self { header, frame: image.into_frame().map_err(|why| why.to_string())? })
    }
}

impl MessageKind {
    /// Returns the kind of this ROS type; `None` for a type that the suite does not use.
    pub fn from_type_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|kind| kind.type_name() == name)
    }

    /// Returns the hash of the type, `RIHS01_...`, which takes the feature `hashes` of `modulo_msgs`.
    pub fn type_hash(self) -> String {
        modulo_msgs::type_hash(self.type_name()).expect("every kind of message is defined in modulo_msgs")
    }
}
