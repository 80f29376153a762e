//! `rcl_interfaces`: parameters and their six services, and log lines.

mod services;

use serde::{Deserialize, Serialize};

pub use self::services::{
    DescribeParametersRequest, DescribeParametersResponse, GetParameterTypesRequest,
    GetParameterTypesResponse, GetParametersRequest, GetParametersResponse, ListParametersRequest,
    ListParametersResponse, SetParametersAtomicallyRequest, SetParametersAtomicallyResponse,
    SetParametersRequest, SetParametersResponse,
};
use crate::builtin::Time;
use crate::interface::interfaces;

/// `rcl_interfaces/msg/ParameterType`: the codes of [`ParameterValue::type`](ParameterValue).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ParameterType;

impl ParameterType {
    /// Not set, or being deleted.
    pub const NOT_SET: u8 = 0;
    /// `bool_value` holds it.
    pub const BOOL: u8 = 1;
    /// `integer_value` holds it.
    pub const INTEGER: u8 = 2;
    /// `double_value` holds it.
    pub const DOUBLE: u8 = 3;
    /// `string_value` holds it.
    pub const STRING: u8 = 4;
    /// `byte_array_value` holds it.
    pub const BYTE_ARRAY: u8 = 5;
    /// `bool_array_value` holds it.
    pub const BOOL_ARRAY: u8 = 6;
    /// `integer_array_value` holds it.
    pub const INTEGER_ARRAY: u8 = 7;
    /// `double_array_value` holds it.
    pub const DOUBLE_ARRAY: u8 = 8;
    /// `string_array_value` holds it.
    pub const STRING_ARRAY: u8 = 9;
}

/// `rcl_interfaces/msg/ParameterValue`: one of these, as `type` tells.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ParameterValue {
    /// A code of [`ParameterType`].
    pub r#type: u8,
    /// For [`ParameterType::BOOL`].
    pub bool_value: bool,
    /// For [`ParameterType::INTEGER`].
    pub integer_value: i64,
    /// For [`ParameterType::DOUBLE`].
    pub double_value: f64,
    /// For [`ParameterType::STRING`].
    pub string_value: String,
    /// For [`ParameterType::BYTE_ARRAY`].
    #[serde(with = "crate::bytes")]
    pub byte_array_value: Vec<u8>,
    /// For [`ParameterType::BOOL_ARRAY`].
    pub bool_array_value: Vec<bool>,
    /// For [`ParameterType::INTEGER_ARRAY`].
    pub integer_array_value: Vec<i64>,
    /// For [`ParameterType::DOUBLE_ARRAY`].
    pub double_array_value: Vec<f64>,
    /// For [`ParameterType::STRING_ARRAY`].
    pub string_array_value: Vec<String>,
}

/// `rcl_interfaces/msg/Parameter`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// The parameter's name.
    pub name: String,
    /// The parameter's value.
    pub value: ParameterValue,
}

/// `rcl_interfaces/msg/FloatingPointRange`: `[from_value, to_value]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FloatingPointRange {
    /// Smallest.
    pub from_value: f64,
    /// Largest.
    pub to_value: f64,
    /// Distance of possible values; 0: any between.
    pub step: f64,
}

/// `rcl_interfaces/msg/IntegerRange`: `[from_value, to_value]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct IntegerRange {
    /// Smallest.
    pub from_value: i64,
    /// Largest.
    pub to_value: i64,
    /// Distance of possible values; 0: any between.
    pub step: u64,
}

/// `rcl_interfaces/msg/ParameterDescriptor`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ParameterDescriptor {
    /// The parameter's name.
    pub name: String,
    /// A code of [`ParameterType`].
    pub r#type: u8,
    /// One sentence, with the unit.
    pub description: String,
    /// What else holds, in words.
    pub additional_constraints: String,
    /// Fixed at the start of the node.
    pub read_only: bool,
    /// Whether the type may change.
    pub dynamic_typing: bool,
    /// One range at most.
    pub floating_point_range: Vec<FloatingPointRange>,
    /// One range at most.
    pub integer_range: Vec<IntegerRange>,
}

/// `rcl_interfaces/msg/ParameterEvent`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ParameterEvent {
    /// When it happened.
    pub stamp: Time,
    /// The node's full name.
    pub node: String,
    /// Parameters that were not there before.
    pub new_parameters: Vec<Parameter>,
    /// Parameters with another value than before.
    pub changed_parameters: Vec<Parameter>,
    /// Parameters that are gone.
    pub deleted_parameters: Vec<Parameter>,
}

/// `rcl_interfaces/msg/SetParametersResult`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetParametersResult {
    /// Whether the value was accepted.
    pub successful: bool,
    /// Why not.
    pub reason: String,
}

/// `rcl_interfaces/msg/ListParametersResult`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ListParametersResult {
    /// The parameters.
    pub names: Vec<String>,
    /// Their prefixes.
    pub prefixes: Vec<String>,
}

/// `rcl_interfaces/msg/Log`: one line of `/rosout`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Log {
    /// When it was written.
    pub stamp: Time,
    /// [`Log::DEBUG`], `INFO`, `WARN`, `ERROR` or `FATAL`.
    pub level: u8,
    /// The logger.
    pub name: String,
    /// The line.
    pub msg: String,
    /// Source file.
    pub file: String,
    /// Function in it.
    pub function: String,
    /// Line in it.
    pub line: u32,
}

impl Log {
    /// Only of interest to a developer.
    pub const DEBUG: u8 = 10;
    /// What goes on.
    pub const INFO: u8 = 20;
    /// Something should be looked at.
    pub const WARN: u8 = 30;
    /// Something failed.
    pub const ERROR: u8 = 40;
    /// The node ends.
    pub const FATAL: u8 = 50;
}

interfaces! {
    ParameterType = "rcl_interfaces/msg/ParameterType",
    ParameterValue = "rcl_interfaces/msg/ParameterValue",
    Parameter = "rcl_interfaces/msg/Parameter",
    FloatingPointRange = "rcl_interfaces/msg/FloatingPointRange",
    IntegerRange = "rcl_interfaces/msg/IntegerRange",
    ParameterDescriptor = "rcl_interfaces/msg/ParameterDescriptor",
    ParameterEvent = "rcl_interfaces/msg/ParameterEvent",
    SetParametersResult = "rcl_interfaces/msg/SetParametersResult",
    ListParametersResult = "rcl_interfaces/msg/ListParametersResult",
    Log = "rcl_interfaces/msg/Log",
}
