//! ROS 2 YAML launch files: parser, plan and process supervisor.
//!
//! Data flows one way: a file is read into actions, the actions are evaluated
//! into a [`Plan`], and a plan is run, printed, or translated for one process.
//!
//! The dialect is a subset of ROS 2's own: what is accepted here means the same
//! to `ros2 launch`, and what is not supported is refused by name.

mod action;
mod attributes;
mod error;
mod package;
pub mod plan;
mod progress;
pub mod substitution;
pub mod summary;
pub mod supervisor;
mod yaml;

pub use error::{LaunchError, Mistakes};
pub use package::{FoundFile, SUITE, launch_files};
pub use plan::{
    ComposedNode, DeclaredArgument, NodePlan, Plan, check, compose, declared_arguments, resolve,
    ros_arguments,
};
pub use progress::Progress;
pub use summary::{NodeReport, Summary, reports_so_far};
pub use supervisor::{Ending, Outcome, Supervision, run};
