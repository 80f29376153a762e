//! `std_srvs`: requests and responses of the three standard services.

use serde::{Deserialize, Serialize};

use crate::interface::interfaces;

/// `std_srvs/srv/Empty_Request`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct EmptyRequest;

/// `std_srvs/srv/Empty_Response`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct EmptyResponse;

/// `std_srvs/srv/SetBool_Request`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetBoolRequest {
    /// On or off.
    pub data: bool,
}

/// `std_srvs/srv/SetBool_Response`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetBoolResponse {
    /// Whether it was done.
    pub success: bool,
    /// Why not, or what else there is to say.
    pub message: String,
}

/// `std_srvs/srv/Trigger_Request`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerRequest;

/// `std_srvs/srv/Trigger_Response`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerResponse {
    /// Whether it was done.
    pub success: bool,
    /// Why not, or what else there is to say.
    pub message: String,
}

interfaces! {
    EmptyRequest = "std_srvs/srv/Empty_Request",
    EmptyResponse = "std_srvs/srv/Empty_Response",
    SetBoolRequest = "std_srvs/srv/SetBool_Request",
    SetBoolResponse = "std_srvs/srv/SetBool_Response",
    TriggerRequest = "std_srvs/srv/Trigger_Request",
    TriggerResponse = "std_srvs/srv/Trigger_Response",
}
