//! The messages against what ROS 2 itself wrote and reported.

mod damage;
mod definitions;
mod golden;
mod images;
mod wire;
