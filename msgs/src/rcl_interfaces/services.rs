//! Requests and responses of the six services that make up ROS 2 parameters.

use serde::{Deserialize, Serialize};

use super::{ListParametersResult, Parameter, ParameterDescriptor, ParameterValue, SetParametersResult};
use crate::interface::interfaces;

/// `rcl_interfaces/srv/DescribeParameters_Request`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DescribeParametersRequest {
    /// The parameters asked for.
    pub names: Vec<String>,
}

/// `rcl_interfaces/srv/DescribeParameters_Response`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DescribeParametersResponse {
    /// In order of the request.
    pub descriptors: Vec<ParameterDescriptor>,
}

/// `rcl_interfaces/srv/GetParameterTypes_Request`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetParameterTypesRequest {
    /// The parameters asked for.
    pub names: Vec<String>,
}

/// `rcl_interfaces/srv/GetParameterTypes_Response`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetParameterTypesResponse {
    /// Codes of [`ParameterType`](super::ParameterType), in order of the request.
    #[serde(with = "crate::bytes")]
    pub types: Vec<u8>,
}

/// `rcl_interfaces/srv/GetParameters_Request`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetParametersRequest {
    /// The parameters asked for.
    pub names: Vec<String>,
}

/// `rcl_interfaces/srv/GetParameters_Response`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GetParametersResponse {
    /// In order of the request.
    pub values: Vec<ParameterValue>,
}

/// `rcl_interfaces/srv/ListParameters_Request`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ListParametersRequest {
    /// Only below these; empty: all.
    pub prefixes: Vec<String>,
    /// How far down, in parts of a name; [`ListParametersRequest::DEPTH_RECURSIVE`]: all the way.
    pub depth: u64,
}

impl ListParametersRequest {
    /// No limit of depth.
    pub const DEPTH_RECURSIVE: u64 = 0;
}

/// `rcl_interfaces/srv/ListParameters_Response`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ListParametersResponse {
    /// The parameters.
    pub result: ListParametersResult,
}

/// `rcl_interfaces/srv/SetParameters_Request`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SetParametersRequest {
    /// Each one is accepted or refused on its own.
    pub parameters: Vec<Parameter>,
}

/// `rcl_interfaces/srv/SetParameters_Response`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetParametersResponse {
    /// In order of the request.
    pub results: Vec<SetParametersResult>,
}

/// `rcl_interfaces/srv/SetParametersAtomically_Request`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SetParametersAtomicallyRequest {
    /// All are accepted or none.
    pub parameters: Vec<Parameter>,
}

/// `rcl_interfaces/srv/SetParametersAtomically_Response`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetParametersAtomicallyResponse {
    /// One for all.
    pub result: SetParametersResult,
}

interfaces! {
    DescribeParametersRequest = "rcl_interfaces/srv/DescribeParameters_Request",
    DescribeParametersResponse = "rcl_interfaces/srv/DescribeParameters_Response",
    GetParameterTypesRequest = "rcl_interfaces/srv/GetParameterTypes_Request",
    GetParameterTypesResponse = "rcl_interfaces/srv/GetParameterTypes_Response",
    GetParametersRequest = "rcl_interfaces/srv/GetParameters_Request",
    GetParametersResponse = "rcl_interfaces/srv/GetParameters_Response",
    ListParametersRequest = "rcl_interfaces/srv/ListParameters_Request",
    ListParametersResponse = "rcl_interfaces/srv/ListParameters_Response",
    SetParametersRequest = "rcl_interfaces/srv/SetParameters_Request",
    SetParametersResponse = "rcl_interfaces/srv/SetParameters_Response",
    SetParametersAtomicallyRequest = "rcl_interfaces/srv/SetParametersAtomically_Request",
    SetParametersAtomicallyResponse = "rcl_interfaces/srv/SetParametersAtomically_Response",
}
