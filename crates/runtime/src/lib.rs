//! What a node stands on without any transport: its step, the messages between steps, its parameters, the description of its
//! sensor, its report, and the driver that runs steps in order.
//!
//! A node is a pure step ([`Node`]). This crate does not know what any node computes, opens no connection and handles no
//! signal; `modulo-middleware` runs the same steps over a transport. Only `clock.rs` reads the clock of the machine.

pub mod clock;
pub mod embedded;
pub mod input;
pub mod launcher;
pub mod lockstep;
pub mod message;
pub mod name;
pub mod node;
pub mod output;
pub mod parameter;
pub mod report;
pub mod ros_args;
pub mod secret;
pub mod stop;
pub mod topic;
pub mod trace;
mod warning;
pub mod yaml;

/// The sensor behind the images: its parameters, and the description that a camera publishes with each frame.
pub mod sensor {
    mod fitness;
    pub mod info;
    #[cfg(feature = "options")]
    pub mod options;
    pub mod parameters;
    pub mod recovery;
    pub mod scale;
}

/// The texts and bytes that rmw_zenoh writes on the wire.
pub mod wire {
    pub mod attachment;
    pub mod keys;
}

pub use clock::{Clock, ManualClock, SystemClock};
pub use message::{Message, MessageKind, StampedFrame};
pub use name::NodeName;
pub use node::{Context, Flow, Job, Node, Part, PlannedInputs, StepError, StepOutput, Trigger, stream_of};
pub use parameter::{Allowed, Descriptor, ParameterError, ParameterSet, Parameters, Value};
pub use report::NodeReport;
pub use sensor::info as sensor_info;
pub use sensor::parameters::{SensorModel, SensorOverride};
pub use sensor::scale::{LightScale, StreamKind, StreamScale};
pub use stop::{Stop, Urgency};
pub use topic::{Address, Qos, Topic};
pub use warning::{RareWarnings, shown, warn_once};
