//! The messages against what ROS 2 itself wrote and reported.

#[path = "../../../tests/harness/data.rs"]
mod data;
mod definitions;
mod golden;
mod images;
mod peer;
mod wire;
mod yuv;
