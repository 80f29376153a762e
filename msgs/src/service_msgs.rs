//! `service_msgs`: the common fields of all service events.

use crate::builtin::Time;
use crate::interface::messages;

messages! {
    ServiceEventInfo = "service_msgs/msg/ServiceEventInfo" {
        /// [`ServiceEventInfo::REQUEST_SENT`], `REQUEST_RECEIVED`, `RESPONSE_SENT` or `RESPONSE_RECEIVED`.
        event_type: u8,
        /// Time of the event.
        stamp: Time,
        /// Global id of the client.
        client_gid: [u8; 16],
        /// Number of the call at the client, from 1.
        sequence_number: i64,
    }
}

impl ServiceEventInfo {
    /// A client has sent a request.
    pub const REQUEST_SENT: u8 = 0;
    /// A server has received a request.
    pub const REQUEST_RECEIVED: u8 = 1;
    /// A server has sent a response.
    pub const RESPONSE_SENT: u8 = 2;
    /// A client has received a response.
    pub const RESPONSE_RECEIVED: u8 = 3;
}
