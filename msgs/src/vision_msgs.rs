//! `vision_msgs`: detections, boxes as centre and size in px of the original image.

use serde::{Deserialize, Serialize};

use crate::geometry_msgs::PoseWithCovariance;
use crate::interface::interfaces;
use crate::std_msgs::Header;

/// `vision_msgs/msg/Point2D`
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Point2D {
    /// Column, px.
    pub x: f64,
    /// Row, px.
    pub y: f64,
}

/// `vision_msgs/msg/Pose2D`
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pose2D {
    /// Where.
    pub position: Point2D,
    /// Rotation, rad.
    pub theta: f64,
}

/// `vision_msgs/msg/BoundingBox2D`
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BoundingBox2D {
    /// Centre, px, and rotation about it.
    pub center: Pose2D,
    /// Width before the rotation, px.
    pub size_x: f64,
    /// Height before the rotation, px.
    pub size_y: f64,
}

/// `vision_msgs/msg/ObjectHypothesis`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ObjectHypothesis {
    /// Class name.
    pub class_id: String,
    /// Confidence in `[0, 1]`.
    pub score: f64,
}

/// `vision_msgs/msg/ObjectHypothesisWithPose`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ObjectHypothesisWithPose {
    /// What it may be.
    pub hypothesis: ObjectHypothesis,
    /// Where it would then be.
    pub pose: PoseWithCovariance,
}

/// `vision_msgs/msg/Detection2D`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Detection2D {
    /// Stamp and frame of the image.
    pub header: Header,
    /// What the object may be.
    pub results: Vec<ObjectHypothesisWithPose>,
    /// Where in the image it is.
    pub bbox: BoundingBox2D,
    /// The same over several images, if it is tracked; else empty.
    pub id: String,
}

/// `vision_msgs/msg/Detection2DArray`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Detection2DArray {
    /// Stamp and frame of the image.
    pub header: Header,
    /// The objects; empty when nothing was seen.
    pub detections: Vec<Detection2D>,
}

interfaces! {
    Point2D = "vision_msgs/msg/Point2D",
    Pose2D = "vision_msgs/msg/Pose2D",
    BoundingBox2D = "vision_msgs/msg/BoundingBox2D",
    ObjectHypothesis = "vision_msgs/msg/ObjectHypothesis",
    ObjectHypothesisWithPose = "vision_msgs/msg/ObjectHypothesisWithPose",
    Detection2D = "vision_msgs/msg/Detection2D",
    Detection2DArray = "vision_msgs/msg/Detection2DArray",
}
