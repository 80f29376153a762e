//! `vision_msgs`.

use serde::{Deserialize, Serialize};

use crate::std_msgs::Header;

/// `vision_msgs/msg/Detection2DArray`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Detection2DArray {
    /// Stamp and frame of the image.
    pub header: Header,
}
