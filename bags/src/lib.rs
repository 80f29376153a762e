//! Recorded frames of every kind: folders of images, KITTI, and rosbag2 MCAP
//! bags, read and written.
//!
//! Nothing here reads a clock of its own, opens a connection or knows of any
//! node: `capture` and `replay` are lent a transport and a clock.

pub mod bag;
pub mod capture;
pub mod control;
pub mod import;
pub mod pace;
pub mod play;
pub mod record;
pub mod replay;
pub mod source;

/// Where recorded images are in a bag that was imported here.
pub const IMAGE_TOPIC: &str = "/camera/image_raw";

/// Where labels are in a bag, as `vision_msgs/msg/Detection2DArray` with the
/// stamps of the images.
pub const GROUND_TRUTH_TOPIC: &str = "/ground_truth";
