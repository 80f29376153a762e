//! `geometry_msgs`: the pose that vision messages carry.

use serde::{Deserialize, Serialize};

use crate::interface::{Interface, messages};

messages! {
    #[derive(Copy)]
    Point = "geometry_msgs/msg/Point" {
        /// Coordinate x in m.
        x: f64,
        /// Coordinate y in m.
        y: f64,
        /// Coordinate z in m.
        z: f64,
    }
    #[derive(Copy)]
    Pose = "geometry_msgs/msg/Pose" {
        /// Position.
        position: Point,
        /// Orientation.
        orientation: Quaternion,
    }
}

/// `geometry_msgs/msg/Quaternion`: a rotation. The default is the identity (w = 1).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quaternion {
    /// Coefficient of i.
    pub x: f64,
    /// Coefficient of j.
    pub y: f64,
    /// Coefficient of k.
    pub z: f64,
    /// Real part.
    pub w: f64,
}

impl Default for Quaternion {
    fn default() -> Self {
        Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

impl Interface for Quaternion {
    const NAME: &'static str = "geometry_msgs/msg/Quaternion";
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

impl Default for PoseWithCovariance {
    fn default() -> Self {
        Self { pose: Pose::default(), covariance: [0.0; 36] }
    }
}

impl Interface for PoseWithCovariance {
    const NAME: &'static str = "geometry_msgs/msg/PoseWithCovariance";
}
