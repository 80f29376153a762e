//! The messages that topics carry: one module for each ROS package.

/// `builtin_interfaces`: points in time and durations.
pub mod builtin {
    const NS: i64 = 1_000_000_000;

    messages! {
        /// A point in time since the Unix epoch.
        #[derive(Copy, Eq, Hash)]
        Time = "builtin_interfaces/msg/Time" {
            sec: i32,
            /// Nanoseconds of the second, in 0 to 999,999,999.
            nanosec: u32,
        }
        /// A signed duration.
        #[derive(Copy, Eq, Hash)]
        Duration = "builtin_interfaces/msg/Duration" {
            /// Whole seconds, rounded down.
            sec: i32,
            /// Nanoseconds to add, in 0 to 999,999,999.
            nanosec: u32,
        }
    }

    impl Time {
        /// The last time that the message can hold; it is in the year 2038.
        pub const MAX: Self = Self { sec: i32::MAX, nanosec: 999_999_999 };

        /// Returns the time `ns` nanoseconds after the epoch, at most [`Time::MAX`].
        pub fn from_ns(ns: u64) -> Self {
            // 32 bits of seconds end in the year 2038: a later time becomes the last one, and never an early one.
            let nanosec = (ns % NS as u64) as u32;
            i32::try_from(ns / NS as u64).map_or(Self::MAX, |sec| Self { sec, nanosec })
        }

        /// Returns the nanoseconds since the epoch; times before it give 0.
        pub fn as_ns(self) -> u64 {
            // The message allows more nanoseconds than one second has, so that both fields are added before the clamp.
            let ns = i64::from(self.sec) * NS + i64::from(self.nanosec);
            u64::try_from(ns).unwrap_or(0)
        }
    }

    #[cfg(test)]
    mod tests {
        use proptest::prelude::*;

        use super::*;

        #[test]
        fn saturates_at_both_ends() {
            assert_eq!(Time::from_ns(u64::MAX), Time::MAX);
            assert_eq!(Time::from_ns(Time::MAX.as_ns() + 1), Time::MAX);
            assert_eq!(Time { sec: -1, nanosec: 999_999_999 }.as_ns(), 0);
            assert_eq!(Time { sec: i32::MIN, nanosec: 0 }.as_ns(), 0);
            assert_eq!(Time { sec: -1, nanosec: 1_000_000_007 }.as_ns(), 7);
            assert_eq!(Time { sec: 1, nanosec: u32::MAX }.as_ns(), 5_294_967_295);
        }

        proptest! {
            #[test]
            fn nanoseconds_return(ns in 0..=2_147_483_647_999_999_999_u64) {
                let time = Time::from_ns(ns);
                prop_assert!(time.nanosec < 1_000_000_000);
                prop_assert_eq!(time.as_ns(), ns);
            }
        }
    }
}

/// `std_msgs`: the header that every stamped message carries, and a text.
pub mod std_msgs {
    pub use super::builtin::Time;

    messages! {
        Header = "std_msgs/msg/Header" {
            /// Time at which the data was acquired.
            stamp: Time,
            /// Name of the coordinate frame, such as `camera`.
            frame_id: std::string::String,
        }
        String = "std_msgs/msg/String" {
            data: std::string::String,
        }
    }
}

/// `geometry_msgs`: the pose that vision messages carry.
pub mod geometry_msgs {
    use serde::{Deserialize, Serialize};

    use crate::Interface;

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
            position: Point,
            orientation: Quaternion,
        }
        #[derive(Copy)]
        PoseWithCovariance = "geometry_msgs/msg/PoseWithCovariance" {
            pose: Pose,
            /// Rows of the covariance over (x, y, z, rotation about x, y, z). Rows of an array have no length on the wire, so
            /// that these are the 36 values of ROS.
            covariance: [[f64; 6]; 6],
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
}

/// `sensor_msgs`: images and camera calibrations.
pub mod sensor_msgs {
    use super::std_msgs::Header;

    messages! {
        /// Rows of pixels; the first row is the top one.
        Image = "sensor_msgs/msg/Image" {
            /// Stamp and coordinate frame of the exposure.
            header: Header,
            height: u32,
            width: u32,
            /// Channels, their order and their depth, such as `rgb8` or `mono16`.
            encoding: String,
            /// Byte order of the samples: 0 is little endian, any other value big endian.
            is_bigendian: u8,
            /// Number of bytes from the start of one row to the start of the next one.
            step: u32,
            /// `height * step` bytes.
            #[serde(with = "crate::cdr::bytes")]
            data: Vec<u8>,
        }
        CompressedImage = "sensor_msgs/msg/CompressedImage" {
            /// Stamp and coordinate frame of the exposure.
            header: Header,
            /// Format of the file, such as `jpeg` or `png`.
            format: String,
            /// Content of the compressed file.
            #[serde(with = "crate::cdr::bytes")]
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
            x_offset: u32,
            y_offset: u32,
            height: u32,
            width: u32,
            /// Whether the region is to be rectified separately.
            do_rectify: bool,
        }
    }
}

/// `vision_msgs`: detections. Boxes have a centre and a size in px of the original image.
pub mod vision_msgs {
    use super::geometry_msgs::PoseWithCovariance;
    use super::std_msgs::Header;

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
        VisionClass = "vision_msgs/msg/VisionClass" {
            /// Index of the class in the output of the model.
            class_id: u16,
            class_name: String,
        }
        LabelInfo = "vision_msgs/msg/LabelInfo" {
            /// The time at which the classes came into use.
            header: Header,
            /// The classes that are published.
            class_map: Vec<VisionClass>,
            /// Smallest score that is published.
            threshold: f32,
        }
        VisionInfo = "vision_msgs/msg/VisionInfo" {
            /// The time at which the classes came into use.
            header: Header,
            /// Name of the method or model.
            method: String,
            /// The place where the meaning of `class_id` is found, such as the name of a parameter.
            database_location: String,
            /// Number of the version of that meaning; it changes with each change of the classes.
            database_version: i32,
        }
    }
}

/// `diagnostic_msgs`: the condition of the nodes.
pub mod diagnostic_msgs {
    use super::std_msgs::Header;

    messages! {
        KeyValue = "diagnostic_msgs/msg/KeyValue" {
            /// Name of the measurement, with its unit.
            key: String,
            /// The measurement.
            value: String,
        }
        DiagnosticStatus = "diagnostic_msgs/msg/DiagnosticStatus" {
            /// [`DiagnosticStatus::OK`], `WARN`, `ERROR` or `STALE`.
            level: u8,
            /// Node and component, such as `detector: inference`.
            name: String,
            /// One line for a person.
            message: String,
            /// The hardware that the component runs on.
            hardware_id: String,
            /// Measurements.
            values: Vec<KeyValue>,
        }
        DiagnosticArray = "diagnostic_msgs/msg/DiagnosticArray" {
            /// The time at which the values were gathered.
            header: Header,
            /// One entry for each component.
            status: Vec<DiagnosticStatus>,
        }
    }

    impl KeyValue {
        /// Returns the measurements `pairs` of (name, value).
        pub fn all<K: Into<String>>(pairs: impl IntoIterator<Item = (K, String)>) -> Vec<Self> {
            pairs.into_iter().map(|(key, value)| Self { key: key.into(), value }).collect()
        }
    }

    impl DiagnosticArray {
        /// Returns the first measurement called `key`.
        pub fn value(&self, key: &str) -> Option<&str> {
            let mut values = self.status.iter().flat_map(|status| &status.values);
            values.find(|value| value.key == key).map(|value| value.value.as_str())
        }
    }

    impl DiagnosticStatus {
        /// The component works.
        pub const OK: u8 = 0;
        /// The component works, but a person should look at it.
        pub const WARN: u8 = 1;
        /// The component does not work.
        pub const ERROR: u8 = 2;
        /// The component has sent no data for too long.
        pub const STALE: u8 = 3;
    }
}

/// `rosgraph_msgs`: simulated time.
pub mod rosgraph_msgs {
    use super::builtin::Time;

    messages! {
        #[derive(Copy)]
        Clock = "rosgraph_msgs/msg/Clock" {
            clock: Time,
        }
    }
}
