//! What a node stands on: the step, its drivers, topics, queues, parameters,
//! clock and transport.
//!
//! A node is a pure step ([`Node`]); nothing in this crate knows what any node
//! computes, and only `transport/zenoh` and `clock.rs` know the wire and the
//! wall clock.

pub mod bridge;
pub mod clock;
pub mod diagnostics;
pub mod driver;
pub mod launcher;
pub mod message;
pub mod name;
pub mod node;
pub mod node_time;
pub mod parameter;
pub mod queue;
pub mod report;
pub mod report_file;
pub mod ros_args;
pub mod rosout;
pub mod saved_state;
pub mod sensor_info;
pub mod sensor_parameters;
pub mod signals;
pub mod stop;
pub mod topic;
pub mod transport;
pub mod type_description_service;

pub use clock::{Clock, ManualClock, SystemClock};
pub use message::{Message, MessageKind, StampedFrame};
pub use name::NodeName;
pub use node::{Context, Flow, Node, StepError, StepOutput, Trigger};
pub use parameter::{Allowed, Descriptor, ParameterError, ParameterSet, Parameters, Value};
pub use report::NodeReport;
pub use sensor_parameters::SensorModel;
pub use stop::{Stop, Urgency};
pub use topic::{Qos, Topic};
