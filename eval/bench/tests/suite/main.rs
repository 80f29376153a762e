//! The commands and the scenes of the benchmarks, and what the methods promise on them.

// Helpers of tests may unwrap as tests do.
#![allow(clippy::unwrap_used)]

#[path = "../../../../tests/harness/data.rs"]
mod data;

mod commands;
mod radiance;
mod stability;
mod trust;
