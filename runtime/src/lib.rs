//! What a node stands on: the step, its drivers, topics, mailboxes,
//! parameters, clock and transport.
//!
//! A node is a pure step ([`Node`]); nothing in this crate knows what any node
//! computes.

pub mod clock;
pub mod message;
pub mod node;
pub mod parameter;
pub mod topic;

pub use clock::{Clock, ManualClock, SystemClock};
pub use message::{Message, MessageKind, StampedFrame};
pub use node::{Context, Cue, Flow, Node, StepError};
pub use parameter::{Descriptor, Parameters, Refusal, Value};
pub use topic::{Qos, Topic};
