//! What the crate promises, seen from outside.

mod bags;
mod control;
mod damage;
mod files;
mod images;
mod kitti;
mod play;
mod ros1;
mod shared;
mod sqlite;
mod writing;
