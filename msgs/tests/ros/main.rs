//! The messages against what ROS 2 itself wrote and reported.

mod damage;
#[path = "../../../tests/harness/data.rs"]
mod data;
mod definitions;
mod golden;
mod images;
mod wire;
