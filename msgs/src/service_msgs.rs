//! `service_msgs`: the part common to all service events.

use serde::{Deserialize, Serialize};

use crate::builtin::Time;
use crate::interface::interfaces;

/// `service_msgs/msg/ServiceEventInfo`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ServiceEventInfo {
    /// [`ServiceEventInfo::REQUEST_SENT`] and so on.
    pub event_type: u8,
    /// When it happened.
    pub stamp: Time,
    /// The client's id on the wire.
    pub client_gid: [u8; 16],
    /// The client's number of the call, from 1.
    pub sequence_number: i64,
}

impl ServiceEventInfo {
    /// A client asked.
    pub const REQUEST_SENT: u8 = 0;
    /// A server was asked.
    pub const REQUEST_RECEIVED: u8 = 1;
    /// A server answered.
    pub const RESPONSE_SENT: u8 = 2;
    /// A client was answered.
    pub const RESPONSE_RECEIVED: u8 = 3;
}

interfaces! {
    ServiceEventInfo = "service_msgs/msg/ServiceEventInfo",
}
