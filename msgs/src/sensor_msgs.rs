//! `sensor_msgs`: images and the camera behind them.

use serde::{Deserialize, Serialize};

use crate::interface::interfaces;
use crate::std_msgs::Header;

/// `sensor_msgs/msg/Image`: rows of pixels, the first row is the top.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Image {
    /// Stamp and frame of the exposure.
    pub header: Header,
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// Such as `rgb8` or `mono16`: channels, their order and their depth.
    pub encoding: String,
    /// 0: samples are little endian; else big endian.
    pub is_bigendian: u8,
    /// Bytes from one row's start to the next one's.
    pub step: u32,
    /// `height * step` bytes.
    #[serde(with = "crate::bytes")]
    pub data: Vec<u8>,
}

/// `sensor_msgs/msg/CompressedImage`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CompressedImage {
    /// Stamp and frame of the exposure.
    pub header: Header,
    /// Such as `jpeg` or `png`.
    pub format: String,
    /// The compressed file.
    #[serde(with = "crate::bytes")]
    pub data: Vec<u8>,
}

/// `sensor_msgs/msg/CameraInfo`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraInfo {
    /// Stamp and frame of the exposure.
    pub header: Header,
    /// Rows of the calibrated image.
    pub height: u32,
    /// Columns of the calibrated image.
    pub width: u32,
    /// Such as `plumb_bob`.
    pub distortion_model: String,
    /// Distortion, as the model defines it; empty: none.
    pub d: Vec<f64>,
    /// Intrinsics of the raw image, 3 x 3 row-major, px; `k[0]` = 0: not calibrated.
    pub k: [f64; 9],
    /// Rectification, 3 x 3 row-major.
    pub r: [f64; 9],
    /// Projection of the rectified image, 3 x 4 row-major, px.
    pub p: [f64; 12],
    /// Columns that make one; 0 means 1.
    pub binning_x: u32,
    /// Rows that make one; 0 means 1.
    pub binning_y: u32,
    /// The part that was read out; all 0: the whole image.
    pub roi: RegionOfInterest,
}

/// `sensor_msgs/msg/RegionOfInterest`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RegionOfInterest {
    /// Leftmost column.
    pub x_offset: u32,
    /// Top row.
    pub y_offset: u32,
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// Whether the part is to be rectified on its own.
    pub do_rectify: bool,
}

interfaces! {
    Image = "sensor_msgs/msg/Image",
    CompressedImage = "sensor_msgs/msg/CompressedImage",
    CameraInfo = "sensor_msgs/msg/CameraInfo",
    RegionOfInterest = "sensor_msgs/msg/RegionOfInterest",
}
