//! `std_srvs`: requests and responses of the three standard services.

use crate::interface::messages;

messages! {
    EmptyRequest = "std_srvs/srv/Empty_Request"
    EmptyResponse = "std_srvs/srv/Empty_Response"
    SetBoolRequest = "std_srvs/srv/SetBool_Request" {
        /// On or off.
        data: bool,
    }
    SetBoolResponse = "std_srvs/srv/SetBool_Response" {
        /// Whether the server has done it.
        success: bool,
        /// A message for a person, such as the reason for a failure.
        message: String,
    }
    TriggerRequest = "std_srvs/srv/Trigger_Request"
    TriggerResponse = "std_srvs/srv/Trigger_Response" {
        /// Whether the server has done it.
        success: bool,
        /// A message for a person, such as the reason for a failure.
        message: String,
    }
}
