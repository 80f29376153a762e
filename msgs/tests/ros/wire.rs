//! Helpers of several tests: the recorded bytes of a real ROS 2, and reading bytes as the struct of a ROS name.

use std::collections::BTreeMap;

use modulo_msgs::cdr::{self, CdrError};
use modulo_msgs::{
    Interface, builtin_interfaces, diagnostic_msgs, geometry_msgs, rcl_interfaces, rosbag2_interfaces,
    rosgraph_msgs, sensor_msgs, service_msgs, std_msgs, std_srvs, type_description_interfaces, vision_msgs,
};
use serde::Deserialize;

/// One message as ROS 2 Jazzy wrote it. Its padding is not zero.
#[derive(Deserialize)]
pub struct Golden {
    #[serde(rename = "type")]
    pub type_name: String,
    #[serde(rename = "cdr")]
    pub hex: String,
}

impl Golden {
    pub fn bytes(&self) -> Vec<u8> {
        let digits = self.hex.as_bytes().chunks(2);
        digits
            .map(|pair| {
                let text = std::str::from_utf8(pair).expect("hexadecimal digits");
                u8::from_str_radix(text, 16).expect("hexadecimal digits")
            })
            .collect()
    }
}

pub fn goldens() -> BTreeMap<String, Golden> {
    serde_json::from_str(include_str!("../data/golden_cdr.json")).expect("the recorded goldens")
}

/// `bytes` read as the struct called `type_name` and written again.
pub type Reread = fn(&[u8]) -> Result<Vec<u8>, CdrError>;

macro_rules! structs {
    ($($package:ident: $($message:ident),+;)+) => {
        /// Every struct of the crate by its ROS name.
        pub fn structs() -> BTreeMap<&'static str, Reread> {
            BTreeMap::from([$($((
                $package::$message::NAME,
                (|bytes| cdr::to_vec(&cdr::from_slice::<$package::$message>(bytes)?)) as Reread,
            )),+),+])
        }

        /// Every struct's field names, in order.
        pub fn struct_fields() -> BTreeMap<&'static str, Vec<&'static str>> {
            BTreeMap::from([$($((
                $package::$message::NAME,
                fields::of::<$package::$message>(),
            )),+),+])
        }
    };
}

structs! {
    builtin_interfaces: Time, Duration;
    std_msgs: Header, String;
    sensor_msgs: Image, CompressedImage, CameraInfo, RegionOfInterest;
    geometry_msgs: Point, Quaternion, Pose, PoseWithCovariance;
    vision_msgs: Point2D, Pose2D, BoundingBox2D, ObjectHypothesis, ObjectHypothesisWithPose, Detection2D,
        Detection2DArray, LabelInfo, VisionClass, VisionInfo;
    diagnostic_msgs: KeyValue, DiagnosticStatus, DiagnosticArray;
    rosgraph_msgs: Clock;
    rosbag2_interfaces: PauseRequest, PauseResponse, ResumeRequest, ResumeResponse, TogglePausedRequest,
        TogglePausedResponse, IsPausedRequest, IsPausedResponse, SetRateRequest, SetRateResponse, GetRateRequest,
        GetRateResponse, PlayNextRequest, PlayNextResponse, BurstRequest, BurstResponse, SeekRequest, SeekResponse,
        PlayRequest, PlayResponse, StopRequest, StopResponse;
    service_msgs: ServiceEventInfo;
    std_srvs: EmptyRequest, EmptyResponse, SetBoolRequest, SetBoolResponse, TriggerRequest, TriggerResponse;
    type_description_interfaces: FieldType, Field, IndividualTypeDescription, TypeDescription, TypeSource,
        KeyValue, GetTypeDescriptionRequest, GetTypeDescriptionResponse;
    rcl_interfaces: ParameterType, ParameterValue, Parameter, FloatingPointRange, IntegerRange,
        ParameterDescriptor, ParameterEvent, SetParametersResult, ListParametersResult, Log,
        DescribeParametersRequest, DescribeParametersResponse, GetParameterTypesRequest,
        GetParameterTypesResponse, GetParametersRequest, GetParametersResponse, ListParametersRequest,
        ListParametersResponse, SetParametersRequest, SetParametersResponse, SetParametersAtomicallyRequest,
        SetParametersAtomicallyResponse, LoggerLevel, SetLoggerLevelsResult, GetLoggerLevelsRequest,
        GetLoggerLevelsResponse, SetLoggerLevelsRequest, SetLoggerLevelsResponse;
}

/// Asks a struct's `Deserialize` for its field names.
mod fields {
    use serde::de::value::Error;
    use serde::de::{Deserialize, Deserializer, Error as _, Visitor};
    use serde::forward_to_deserialize_any;

    pub fn of<T: for<'de> Deserialize<'de>>() -> Vec<&'static str> {
        let mut asked = Vec::new();
        let _ = T::deserialize(Ask(&mut asked));
        asked
    }

    struct Ask<'a>(&'a mut Vec<&'static str>);

    impl<'de> Deserializer<'de> for Ask<'_> {
        type Error = Error;

        fn deserialize_struct<V: Visitor<'de>>(
            self,
            _: &'static str,
            fields: &'static [&'static str],
            _: V,
        ) -> Result<V::Value, Error> {
            self.0.extend(fields);
            Err(Error::custom("only asked"))
        }

        fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Error> {
            Err(Error::custom("not a struct with fields"))
        }

        forward_to_deserialize_any! {
            bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf option unit
            unit_struct newtype_struct seq tuple tuple_struct map enum identifier ignored_any
        }
    }
}
