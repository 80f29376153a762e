//! The sensor behind the images: its parameters, and the description that a camera publishes with each frame.

pub mod info;
pub mod parameters;
