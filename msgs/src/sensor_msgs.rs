//! `sensor_msgs`.

use serde::{Deserialize, Serialize};

use crate::std_msgs::Header;

/// `sensor_msgs/msg/CompressedImage`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CompressedImage {
    /// Stamp and frame of the exposure.
    pub header: Header,
    /// Such as `jpeg` or `png`.
    pub format: String,
    /// The compressed file.
    pub data: Vec<u8>,
}

/// `sensor_msgs/msg/CameraInfo`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraInfo {
    /// Stamp and frame of the exposure.
    pub header: Header,
}
