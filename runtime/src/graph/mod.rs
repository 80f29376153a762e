//! Everything that the ROS graph sees of a node: its name, its topics, `/diagnostics`, `/rosout`, `/clock` and the
//! descriptions of its types; and the graph itself, with the endpoints that do not fit together.

pub mod conflict;
pub mod diagnostics;
pub mod discovery;
pub mod name;
pub mod node_time;
pub mod rosout;
pub mod service;
pub mod topic;
pub mod type_description;

pub use discovery::Graph;
pub use name::{NameError, NodeName};
pub use topic::{Qos, Topic};
