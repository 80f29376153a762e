//! `sensor_msgs`: images and camera calibrations.

use crate::interface::messages;
use crate::std_msgs::Header;

messages! {
    /// Rows of pixels; the first row is the top one.
    Image = "sensor_msgs/msg/Image" {
        /// Stamp and coordinate frame of the exposure.
        header: Header,
        /// Number of rows.
        height: u32,
        /// Number of columns.
        width: u32,
        /// Channels, their order and their depth, such as `rgb8` or `mono16`.
        encoding: String,
        /// Byte order of the samples: 0 is little endian, any other value big endian.
        is_bigendian: u8,
        /// Number of bytes from the start of one row to the start of the next one.
        step: u32,
        /// `height * step` bytes.
        #[serde(with = "crate::bytes")]
        data: Vec<u8>,
    }
    CompressedImage = "sensor_msgs/msg/CompressedImage" {
        /// Stamp and coordinate frame of the exposure.
        header: Header,
        /// Format of the file, such as `jpeg` or `png`.
        format: String,
        /// Content of the compressed file.
        #[serde(with = "crate::bytes")]
        data: Vec<u8>,
    }
    CameraInfo = "sensor_msgs/msg/CameraInfo" {
        /// Stamp and coordinate frame of the exposure.
        header: Header,
        /// Number of rows of the calibrated image.
        height: u32,
        /// Number of columns of the calibrated image.
        width: u32,
        /// Name of the distortion model, such as `plumb_bob`.
        distortion_model: String,
        /// Coefficients of the distortion model; empty without distortion.
        d: Vec<f64>,
        /// Intrinsics of the raw image in px, 3 x 3 row-major; `k[0]` is 0 for a camera that is not calibrated.
        k: [f64; 9],
        /// Rectification matrix, 3 x 3 row-major.
        r: [f64; 9],
        /// Projection matrix of the rectified image in px, 3 x 4 row-major.
        p: [f64; 12],
        /// Number of columns that are combined into one; 0 means 1.
        binning_x: u32,
        /// Number of rows that are combined into one; 0 means 1.
        binning_y: u32,
        /// The region that was read out; zeros stand for the whole image.
        roi: RegionOfInterest,
    }
    RegionOfInterest = "sensor_msgs/msg/RegionOfInterest" {
        /// Leftmost column.
        x_offset: u32,
        /// Top row.
        y_offset: u32,
        /// Number of rows.
        height: u32,
        /// Number of columns.
        width: u32,
        /// Whether the region is to be rectified separately.
        do_rectify: bool,
    }
}
