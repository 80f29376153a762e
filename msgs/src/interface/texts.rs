//! The table of embedded definitions, sorted by name.

/// (name, text) of each definition, listed by package and by `msg` or `srv`.
macro_rules! definitions {
    ($($package:literal / $kind:literal: $($name:literal)+;)+) => {
        &[$($((
            concat!($package, "/", $kind, "/", $name),
            include_str!(concat!("../../interfaces/", $package, "/", $kind, "/", $name, ".", $kind)),
        ),)+)+]
    };
}

/// (name, text) of every message and service.
pub(super) static DEFINITIONS: &[(&str, &str)] = definitions! {
    "builtin_interfaces" / "msg": "Duration" "Time";
    "diagnostic_msgs" / "msg": "DiagnosticArray" "DiagnosticStatus" "KeyValue";
    "geometry_msgs" / "msg": "Point" "Pose" "PoseWithCovariance" "Quaternion";
    "rcl_interfaces" / "msg": "FloatingPointRange" "IntegerRange" "ListParametersResult" "Log" "Parameter"
        "ParameterDescriptor" "ParameterEvent" "ParameterType" "ParameterValue" "SetParametersResult";
    "rcl_interfaces" / "srv": "DescribeParameters" "GetParameterTypes" "GetParameters" "ListParameters"
        "SetParameters" "SetParametersAtomically";
    "rosbag2_interfaces" / "srv": "Burst" "GetRate" "IsPaused" "Pause" "PlayNext" "Resume" "Seek" "SetRate"
        "TogglePaused";
    "rosgraph_msgs" / "msg": "Clock";
    "sensor_msgs" / "msg": "CameraInfo" "CompressedImage" "Image" "RegionOfInterest";
    "service_msgs" / "msg": "ServiceEventInfo";
    "std_msgs" / "msg": "Header" "String";
    "std_srvs" / "srv": "Empty" "SetBool" "Trigger";
    "type_description_interfaces" / "msg": "Field" "FieldType" "IndividualTypeDescription" "KeyValue"
        "TypeDescription" "TypeSource";
    "type_description_interfaces" / "srv": "GetTypeDescription";
    "vision_msgs" / "msg": "BoundingBox2D" "Detection2D" "Detection2DArray" "ObjectHypothesis"
        "ObjectHypothesisWithPose" "Point2D" "Pose2D";
};
