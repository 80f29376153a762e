//! The table of embedded definitions, sorted by name.

/// (name, text) of every message and service.
pub(super) static DEFINITIONS: &[(&str, &str)] = &[
    ("builtin_interfaces/msg/Duration", include_str!("../../interfaces/builtin_interfaces/msg/Duration.msg")),
    ("builtin_interfaces/msg/Time", include_str!("../../interfaces/builtin_interfaces/msg/Time.msg")),
    (
        "diagnostic_msgs/msg/DiagnosticArray",
        include_str!("../../interfaces/diagnostic_msgs/msg/DiagnosticArray.msg"),
    ),
    (
        "diagnostic_msgs/msg/DiagnosticStatus",
        include_str!("../../interfaces/diagnostic_msgs/msg/DiagnosticStatus.msg"),
    ),
    ("diagnostic_msgs/msg/KeyValue", include_str!("../../interfaces/diagnostic_msgs/msg/KeyValue.msg")),
    ("geometry_msgs/msg/Point", include_str!("../../interfaces/geometry_msgs/msg/Point.msg")),
    ("geometry_msgs/msg/Pose", include_str!("../../interfaces/geometry_msgs/msg/Pose.msg")),
    (
        "geometry_msgs/msg/PoseWithCovariance",
        include_str!("../../interfaces/geometry_msgs/msg/PoseWithCovariance.msg"),
    ),
    ("geometry_msgs/msg/Quaternion", include_str!("../../interfaces/geometry_msgs/msg/Quaternion.msg")),
    (
        "rcl_interfaces/msg/FloatingPointRange",
        include_str!("../../interfaces/rcl_interfaces/msg/FloatingPointRange.msg"),
    ),
    ("rcl_interfaces/msg/IntegerRange", include_str!("../../interfaces/rcl_interfaces/msg/IntegerRange.msg")),
    (
        "rcl_interfaces/msg/ListParametersResult",
        include_str!("../../interfaces/rcl_interfaces/msg/ListParametersResult.msg"),
    ),
    ("rcl_interfaces/msg/Log", include_str!("../../interfaces/rcl_interfaces/msg/Log.msg")),
    ("rcl_interfaces/msg/Parameter", include_str!("../../interfaces/rcl_interfaces/msg/Parameter.msg")),
    (
        "rcl_interfaces/msg/ParameterDescriptor",
        include_str!("../../interfaces/rcl_interfaces/msg/ParameterDescriptor.msg"),
    ),
    (
        "rcl_interfaces/msg/ParameterEvent",
        include_str!("../../interfaces/rcl_interfaces/msg/ParameterEvent.msg"),
    ),
    (
        "rcl_interfaces/msg/ParameterType",
        include_str!("../../interfaces/rcl_interfaces/msg/ParameterType.msg"),
    ),
    (
        "rcl_interfaces/msg/ParameterValue",
        include_str!("../../interfaces/rcl_interfaces/msg/ParameterValue.msg"),
    ),
    (
        "rcl_interfaces/msg/SetParametersResult",
        include_str!("../../interfaces/rcl_interfaces/msg/SetParametersResult.msg"),
    ),
    (
        "rcl_interfaces/srv/DescribeParameters",
        include_str!("../../interfaces/rcl_interfaces/srv/DescribeParameters.srv"),
    ),
    (
        "rcl_interfaces/srv/GetParameterTypes",
        include_str!("../../interfaces/rcl_interfaces/srv/GetParameterTypes.srv"),
    ),
    (
        "rcl_interfaces/srv/GetParameters",
        include_str!("../../interfaces/rcl_interfaces/srv/GetParameters.srv"),
    ),
    (
        "rcl_interfaces/srv/ListParameters",
        include_str!("../../interfaces/rcl_interfaces/srv/ListParameters.srv"),
    ),
    (
        "rcl_interfaces/srv/SetParameters",
        include_str!("../../interfaces/rcl_interfaces/srv/SetParameters.srv"),
    ),
    (
        "rcl_interfaces/srv/SetParametersAtomically",
        include_str!("../../interfaces/rcl_interfaces/srv/SetParametersAtomically.srv"),
    ),
    ("rosbag2_interfaces/srv/Burst", include_str!("../../interfaces/rosbag2_interfaces/srv/Burst.srv")),
    ("rosbag2_interfaces/srv/GetRate", include_str!("../../interfaces/rosbag2_interfaces/srv/GetRate.srv")),
    ("rosbag2_interfaces/srv/IsPaused", include_str!("../../interfaces/rosbag2_interfaces/srv/IsPaused.srv")),
    ("rosbag2_interfaces/srv/Pause", include_str!("../../interfaces/rosbag2_interfaces/srv/Pause.srv")),
    ("rosbag2_interfaces/srv/PlayNext", include_str!("../../interfaces/rosbag2_interfaces/srv/PlayNext.srv")),
    ("rosbag2_interfaces/srv/Resume", include_str!("../../interfaces/rosbag2_interfaces/srv/Resume.srv")),
    ("rosbag2_interfaces/srv/Seek", include_str!("../../interfaces/rosbag2_interfaces/srv/Seek.srv")),
    ("rosbag2_interfaces/srv/SetRate", include_str!("../../interfaces/rosbag2_interfaces/srv/SetRate.srv")),
    (
        "rosbag2_interfaces/srv/TogglePaused",
        include_str!("../../interfaces/rosbag2_interfaces/srv/TogglePaused.srv"),
    ),
    ("rosgraph_msgs/msg/Clock", include_str!("../../interfaces/rosgraph_msgs/msg/Clock.msg")),
    ("sensor_msgs/msg/CameraInfo", include_str!("../../interfaces/sensor_msgs/msg/CameraInfo.msg")),
    ("sensor_msgs/msg/CompressedImage", include_str!("../../interfaces/sensor_msgs/msg/CompressedImage.msg")),
    ("sensor_msgs/msg/Image", include_str!("../../interfaces/sensor_msgs/msg/Image.msg")),
    (
        "sensor_msgs/msg/RegionOfInterest",
        include_str!("../../interfaces/sensor_msgs/msg/RegionOfInterest.msg"),
    ),
    (
        "service_msgs/msg/ServiceEventInfo",
        include_str!("../../interfaces/service_msgs/msg/ServiceEventInfo.msg"),
    ),
    ("std_msgs/msg/Header", include_str!("../../interfaces/std_msgs/msg/Header.msg")),
    ("std_msgs/msg/String", include_str!("../../interfaces/std_msgs/msg/String.msg")),
    ("std_srvs/srv/Empty", include_str!("../../interfaces/std_srvs/srv/Empty.srv")),
    ("std_srvs/srv/SetBool", include_str!("../../interfaces/std_srvs/srv/SetBool.srv")),
    ("std_srvs/srv/Trigger", include_str!("../../interfaces/std_srvs/srv/Trigger.srv")),
    (
        "type_description_interfaces/msg/Field",
        include_str!("../../interfaces/type_description_interfaces/msg/Field.msg"),
    ),
    (
        "type_description_interfaces/msg/FieldType",
        include_str!("../../interfaces/type_description_interfaces/msg/FieldType.msg"),
    ),
    (
        "type_description_interfaces/msg/IndividualTypeDescription",
        include_str!("../../interfaces/type_description_interfaces/msg/IndividualTypeDescription.msg"),
    ),
    (
        "type_description_interfaces/msg/KeyValue",
        include_str!("../../interfaces/type_description_interfaces/msg/KeyValue.msg"),
    ),
    (
        "type_description_interfaces/msg/TypeDescription",
        include_str!("../../interfaces/type_description_interfaces/msg/TypeDescription.msg"),
    ),
    (
        "type_description_interfaces/msg/TypeSource",
        include_str!("../../interfaces/type_description_interfaces/msg/TypeSource.msg"),
    ),
    (
        "type_description_interfaces/srv/GetTypeDescription",
        include_str!("../../interfaces/type_description_interfaces/srv/GetTypeDescription.srv"),
    ),
    ("vision_msgs/msg/BoundingBox2D", include_str!("../../interfaces/vision_msgs/msg/BoundingBox2D.msg")),
    ("vision_msgs/msg/Detection2D", include_str!("../../interfaces/vision_msgs/msg/Detection2D.msg")),
    (
        "vision_msgs/msg/Detection2DArray",
        include_str!("../../interfaces/vision_msgs/msg/Detection2DArray.msg"),
    ),
    (
        "vision_msgs/msg/ObjectHypothesis",
        include_str!("../../interfaces/vision_msgs/msg/ObjectHypothesis.msg"),
    ),
    (
        "vision_msgs/msg/ObjectHypothesisWithPose",
        include_str!("../../interfaces/vision_msgs/msg/ObjectHypothesisWithPose.msg"),
    ),
    ("vision_msgs/msg/Point2D", include_str!("../../interfaces/vision_msgs/msg/Point2D.msg")),
    ("vision_msgs/msg/Pose2D", include_str!("../../interfaces/vision_msgs/msg/Pose2D.msg")),
];
