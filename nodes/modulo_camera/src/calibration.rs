//! The calibration of the camera whose images are the source. It holds for the images of the simulated sensor as well, which has
//! the same pixels.

use std::sync::Arc;

use modulo_msgs::sensor_msgs::CameraInfo;
use modulo_msgs::std_msgs::Header;
use modulo_runtime::topic::camera_info_topic;
use modulo_runtime::{MessageKind, Topic};

/// Returns the topics to read for the images of `name`: they, and the camera info beside them.
pub(crate) fn topics(name: &str) -> Vec<Topic> {
    let camera_info = camera_info_topic(name);
    vec![Topic::new(name, MessageKind::Image), Topic::new(camera_info, MessageKind::CameraInfo)]
}

/// The camera info of the source, as far as it is known.
#[derive(Default)]
pub(crate) struct Calibration {
    /// The topic that brings it; `None` for a source that is no topic.
    pub topic: Option<String>,
    /// That of the next images.
    pub info: Option<Arc<CameraInfo>>,
    /// Whether it was reported that it does not fit the images.
    pub mismatch_reported: bool,
}

impl Calibration {
    /// Returns whether the camera info of the source is on the topic `camera_info` of `node`, such as `/modulo_camera`, and serves
    /// its images as well. The node must not publish there: its readers would get two messages for each image.
    pub fn is_on_topic_of(&self, node: &str) -> bool {
        let namespace = node.rsplit_once('/').map_or("", |(namespace, _)| namespace);
        let own = format!("{namespace}/camera_info");
        // A camera info that has come was not on the node's own topic, which is remapped then.
        let topic = self.topic.as_ref().filter(|_| self.info.is_none());
        topic.is_some_and(|topic| [own.as_str(), "camera_info"].contains(&topic.as_str()))
    }

    /// Returns the camera info of an image of (height, width). Without a calibration, and with one of images of another size,
    /// it has the size of the image and matrices of 0, as ROS 2 defines it for a camera that is not calibrated.
    pub fn of(&mut self, (height, width): (u32, u32), header: &Header) -> CameraInfo {
        let unknown = CameraInfo { header: header.clone(), height, width, ..CameraInfo::default() };
        let Some(info) = self.info.as_ref().filter(|info| info.k[0] != 0.0) else { return unknown };
        let (of_rows, of_columns) = image_size(info);
        if (of_rows, of_columns) == (height, width) {
            return CameraInfo { header: header.clone(), ..CameraInfo::clone(info) };
        }
        if !std::mem::replace(&mut self.mismatch_reported, true) {
            tracing::warn!(
                "the camera info beside the source is for images of {of_columns} x {of_rows} px, but they have {width} x \
                 {height}: it is not passed on"
            );
        }
        unknown
    }
}

/// Returns the (height, width) of the images that a camera info describes: those of its region, after binning.
fn image_size(info: &CameraInfo) -> (u32, u32) {
    let side = |whole: u32, region: u32, binning: u32| {
        let pixels = if region == 0 { whole } else { region };
        pixels / binning.max(1)
    };
    let CameraInfo { roi, binning_x, binning_y, .. } = info;
    (side(info.height, roi.height, *binning_y), side(info.width, roi.width, *binning_x))
}
