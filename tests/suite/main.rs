//! Tests that drive the shipped binary and can share a process: each has a folder and a ROS domain of its own.

#[path = "../harness/mod.rs"]
mod harness;

mod exit_codes;
mod floors;
mod launch;
mod packaging;
mod parameters;
mod recorded;
mod ros;
mod screen;
mod view;
