//! `rosgraph_msgs`: simulated time.

use crate::builtin::Time;
use crate::interface::messages;

messages! {
    #[derive(Copy)]
    Clock = "rosgraph_msgs/msg/Clock" {
        /// The current time.
        clock: Time,
    }
}
