//! Tests that drive the shipped binary and can share a process: each has a folder and a ROS domain of its own.

#[path = "../harness/mod.rs"]
mod harness;

mod accounts;
mod bags;
mod bits;
mod bridge;
mod cases;
mod corpus;
mod crash;
mod detect;
mod doors;
mod eval;
mod launch;
mod live;
mod models;
mod outputs;
mod parameters;
mod refused;
mod repository;
mod ros;
mod screen;
mod session;
mod spikes;
mod video;
mod view;
