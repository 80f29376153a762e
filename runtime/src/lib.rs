//! The runtime of a node: messages come in over a transport, a driver runs the step of the node, and the messages of
//! the step go out again.
//!
//! ```text
//! transport -> queue -> driver -> Node::step -> driver -> transport
//! ```
//!
//! A node is a pure step ([`Node`]). This crate does not know what any node computes. Only `transport/zenoh` names the
//! library of the wire, and only `clock.rs` reads the clock of the machine.

pub mod bridge;
pub mod clock;
pub mod driver;
pub mod graph;
pub mod message;
pub mod node;
pub mod parameter;
pub mod report;
pub mod transport;

/// A node as a process: its command line, its launcher, the signals that end it, and the files that outlast a crash.
pub mod process {
    pub mod launcher;
    pub mod node_files;
    pub mod output;
    pub mod ros_args;
    pub mod stop;
    pub mod trace;
}

/// The sensor behind the images: its parameters, and the description that a camera publishes with each frame.
pub mod sensor {
    pub mod info;
    pub mod options;
    pub mod parameters;
}

pub use clock::{Clock, ManualClock, SystemClock};
pub use graph::{NodeName, Qos, Topic, rosout};
pub use message::{Message, MessageKind, StampedFrame};
pub use node::{
    Context, Flow, Job, Node, Part, PlannedInputs, StepError, StepOutput, Trigger, change_parameters,
};
pub use parameter::{Allowed, Descriptor, ParameterError, ParameterSet, Parameters, Value};
pub use process::stop::{Stop, Urgency, end_on_signals};
pub use process::{launcher, ros_args};
pub use report::NodeReport;
pub use sensor::info as sensor_info;
pub use sensor::parameters::{SensorModel, SensorOverride};
pub use transport::queue;
