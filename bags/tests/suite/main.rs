//! What the crate promises, seen from outside.

mod bags;
mod damage;
mod images;
mod kitti;
mod play;
mod shared;
mod writing;
