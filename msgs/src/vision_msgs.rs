//! `vision_msgs`: detections. Boxes have a centre and a size in px of the original image.

use crate::geometry_msgs::PoseWithCovariance;
use crate::interface::messages;
use crate::std_msgs::Header;

messages! {
    #[derive(Copy)]
    Point2D = "vision_msgs/msg/Point2D" {
        /// Column in px.
        x: f64,
        /// Row in px.
        y: f64,
    }
    #[derive(Copy)]
    Pose2D = "vision_msgs/msg/Pose2D" {
        /// Position.
        position: Point2D,
        /// Rotation in rad.
        theta: f64,
    }
    #[derive(Copy)]
    BoundingBox2D = "vision_msgs/msg/BoundingBox2D" {
        /// Centre in px, and rotation about it.
        center: Pose2D,
        /// Width before the rotation in px.
        size_x: f64,
        /// Height before the rotation in px.
        size_y: f64,
    }
    ObjectHypothesis = "vision_msgs/msg/ObjectHypothesis" {
        /// Name of the class.
        class_id: String,
        /// Confidence in `[0, 1]`.
        score: f64,
    }
    ObjectHypothesisWithPose = "vision_msgs/msg/ObjectHypothesisWithPose" {
        /// Class and confidence.
        hypothesis: ObjectHypothesis,
        /// Pose of the object under this hypothesis.
        pose: PoseWithCovariance,
    }
    Detection2D = "vision_msgs/msg/Detection2D" {
        /// Stamp and coordinate frame of the image.
        header: Header,
        /// Hypotheses about the class of the object.
        results: Vec<ObjectHypothesisWithPose>,
        /// Box of the object in the image.
        bbox: BoundingBox2D,
        /// Id of a tracked object, the same in all images; empty without tracking.
        id: String,
    }
    Detection2DArray = "vision_msgs/msg/Detection2DArray" {
        /// Stamp and coordinate frame of the image.
        header: Header,
        /// The objects; empty when the detector found no object.
        detections: Vec<Detection2D>,
    }
}
