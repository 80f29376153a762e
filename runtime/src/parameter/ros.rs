//! Values of parameters as messages of ROS 2 carry them.

use modulo_msgs::rcl_interfaces::{ParameterType, ParameterValue};

use crate::parameter::Value;

/// Returns a value as ROS writes it; `None` is `NOT_SET`.
pub fn to_ros(value: Option<&Value>) -> ParameterValue {
    let mut ros = ParameterValue::default();
    match value {
        None => ros.r#type = ParameterType::NOT_SET,
        Some(Value::Bool(v)) => (ros.r#type, ros.bool_value) = (ParameterType::BOOL, *v),
        Some(Value::Integer(v)) => (ros.r#type, ros.integer_value) = (ParameterType::INTEGER, *v),
        Some(Value::Double(v)) => (ros.r#type, ros.double_value) = (ParameterType::DOUBLE, *v),
        Some(Value::String(v)) => (ros.r#type, ros.string_value) = (ParameterType::STRING, v.clone()),
        Some(Value::Strings(v)) => {
            (ros.r#type, ros.string_array_value) = (ParameterType::STRING_ARRAY, v.clone());
        }
        Some(Value::Bytes(v)) => (ros.r#type, ros.byte_array_value) = (ParameterType::BYTE_ARRAY, v.clone()),
        Some(Value::Bools(v)) => (ros.r#type, ros.bool_array_value) = (ParameterType::BOOL_ARRAY, v.clone()),
        Some(Value::Integers(v)) => {
            (ros.r#type, ros.integer_array_value) = (ParameterType::INTEGER_ARRAY, v.clone());
        }
        Some(Value::Doubles(v)) => {
            (ros.r#type, ros.double_array_value) = (ParameterType::DOUBLE_ARRAY, v.clone());
        }
    }
    ros
}

/// Converts a value of ROS; `None` when it is not set, or has a type that ROS 2 does not know.
pub fn from_ros(value: ParameterValue) -> Option<Value> {
    Some(match value.r#type {
        ParameterType::BOOL => Value::Bool(value.bool_value),
        ParameterType::INTEGER => Value::Integer(value.integer_value),
        ParameterType::DOUBLE => Value::Double(value.double_value),
        ParameterType::STRING => Value::String(value.string_value),
        ParameterType::BYTE_ARRAY => Value::Bytes(value.byte_array_value),
        ParameterType::BOOL_ARRAY => Value::Bools(value.bool_array_value),
        ParameterType::INTEGER_ARRAY => Value::Integers(value.integer_array_value),
        ParameterType::DOUBLE_ARRAY => Value::Doubles(value.double_array_value),
        ParameterType::STRING_ARRAY => Value::Strings(value.string_array_value),
        _ => return None,
    })
}
