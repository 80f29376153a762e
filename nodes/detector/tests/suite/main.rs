//! The detector as a node, with the embedded model and with a real one.

#[path = "../../../../tests/harness/data.rs"]
mod data;

mod detector;
mod real_model;
