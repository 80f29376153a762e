//! `geometry_msgs`: the pose that vision messages carry.

use serde::{Deserialize, Serialize};

use crate::interface::interfaces;

/// `geometry_msgs/msg/Point`
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// x, m.
    pub x: f64,
    /// y, m.
    pub y: f64,
    /// z, m.
    pub z: f64,
}

/// `geometry_msgs/msg/Quaternion`: a rotation; the default is none (w = 1).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quaternion {
    /// Along x.
    pub x: f64,
    /// Along y.
    pub y: f64,
    /// Along z.
    pub z: f64,
    /// Real part.
    pub w: f64,
}

/// `geometry_msgs/msg/Pose`
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Where.
    pub position: Point,
    /// Which way round.
    pub orientation: Quaternion,
}

/// `geometry_msgs/msg/PoseWithCovariance`
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseWithCovariance {
    /// The pose.
    pub pose: Pose,
    /// 6 x 6 row-major over (x, y, z, rotation about x, y, z).
    #[serde(with = "crate::array")]
    pub covariance: [f64; 36],
}

impl Default for Quaternion {
    fn default() -> Self {
        Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

impl Default for PoseWithCovariance {
    fn default() -> Self {
        Self { pose: Pose::default(), covariance: [0.0; 36] }
    }
}

interfaces! {
    Point = "geometry_msgs/msg/Point",
    Quaternion = "geometry_msgs/msg/Quaternion",
    Pose = "geometry_msgs/msg/Pose",
    PoseWithCovariance = "geometry_msgs/msg/PoseWithCovariance",
}
