//! The names of the messages in ROS, and their definitions.
//!
//! The definitions are embedded in the program; no ROS installation is read.

use crate::definition::{DefinitionError, parse_fields};
use crate::type_description_interfaces::{Field, FieldType, IndividualTypeDescription};

/// A message with a ROS name.
pub trait Interface {
    /// Name of the type, such as `sensor_msgs/msg/Image` or `std_srvs/srv/SetBool_Request`.
    const NAME: &'static str;
}

/// Declares the messages of one ROS package: `Message = "package/msg/Message" { fields }`, the fields as public and in
/// the order of the definition. A message without braces has no fields.
macro_rules! messages {
    (@struct $(#[$about:meta])* $message:ident $name:literal) => {
        #[doc = concat!("`", $name, "`")]
        $(#[$about])*
        #[derive(Clone, Debug, Default, PartialEq, ::serde::Serialize, ::serde::Deserialize)]
        pub struct $message;
    };
    (@struct $(#[$about:meta])* $message:ident $name:literal
        $($(#[$help:meta])+ $field:ident: $type:ty),+ $(,)?
    ) => {
        #[doc = concat!("`", $name, "`")]
        ///
        $(#[$about])*
        #[derive(Clone, Debug, Default, PartialEq, ::serde::Serialize, ::serde::Deserialize)]
        pub struct $message {
            $($(#[$help])+ pub $field: $type,)+
        }
    };
    ($($(#[$about:meta])* $message:ident = $name:literal $({ $($fields:tt)+ })?)+) => {$(
        $crate::interface::messages!(@struct $(#[$about])* $message $name $($($fields)+)?);

        impl $crate::interface::Interface for $message {
            const NAME: &'static str = $name;
        }
    )+};
}
pub(crate) use messages;

/// (name, text) of each definition, listed by package and by `msg` or `srv`.
macro_rules! definitions {
    ($($package:literal / $kind:literal: $($name:literal)+;)+) => {
        &[$($((
            concat!($package, "/", $kind, "/", $name),
            include_str!(concat!("../interfaces/", $package, "/", $kind, "/", $name, ".", $kind)),
        ),)+)+]
    };
}

/// (name, text) of every message and service.
static DEFINITIONS: &[(&str, &str)] = definitions! {
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

/// Returns the `.msg` or `.srv` text of a message or service of the suite, such as `sensor_msgs/msg/Image` or
/// `std_srvs/srv/SetBool`.
pub fn definition(name: &str) -> Option<&'static str> {
    DEFINITIONS.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// Lists the names that [`definition`] knows.
pub fn names() -> impl Iterator<Item = &'static str> {
    DEFINITIONS.iter().map(|(name, _)| *name)
}

/// Returns the fields of a message, of a service, or of the request, response or event of a service; `None` when the
/// suite does not define the type.
pub(crate) fn describe(name: &str) -> Result<Option<IndividualTypeDescription>, DefinitionError> {
    let fields = match (definition(name), name.contains("/srv/")) {
        (Some(_), true) => service(name),
        (Some(text), false) => parse_fields(name, text)?,
        (None, true) => match service_message(name)? {
            Some(fields) => fields,
            None => return Ok(None),
        },
        (None, false) => return Ok(None),
    };
    Ok(Some(IndividualTypeDescription { type_name: name.to_owned(), fields }))
}

/// Returns the three fields that describe a service.
fn service(name: &str) -> Vec<Field> {
    ["request", "response", "event"]
        .map(|part| {
            let suffix = part[..1].to_ascii_uppercase() + &part[1..];
            nested(&format!("{part}_message"), &format!("{name}_{suffix}"), FieldType::NESTED)
        })
        .into()
}

fn service_message(name: &str) -> Result<Option<Vec<Field>>, DefinitionError> {
    let Some((service, part)) = name.rsplit_once('_') else { return Ok(None) };
    let Some(text) = definition(service) else { return Ok(None) };
    let (request, response) = text.split_once("---\n").unwrap_or((text, ""));
    Ok(match part {
        "Request" => Some(parse_fields(name, request)?),
        "Response" => Some(parse_fields(name, response)?),
        "Event" => Some(event(service)),
        _ => None,
    })
}

/// Returns the fields of a service introspection event; request and response are sequences of at most one element.
fn event(service: &str) -> Vec<Field> {
    let at_most_one = FieldType::NESTED + FieldType::BOUNDED_SEQUENCE;
    vec![
        nested("info", "service_msgs/msg/ServiceEventInfo", FieldType::NESTED),
        nested("request", &format!("{service}_Request"), at_most_one),
        nested("response", &format!("{service}_Response"), at_most_one),
    ]
}

fn nested(name: &str, type_name: &str, type_id: u8) -> Field {
    let capacity = u64::from(type_id != FieldType::NESTED);
    let nested_type_name = type_name.to_owned();
    let r#type = FieldType { type_id, capacity, string_capacity: 0, nested_type_name };
    Field { name: name.to_owned(), r#type, default_value: String::new() }
}
