//! The commands of the benchmarks, and the trust and accuracy of the methods on their scenes.

// Helpers of tests may unwrap as tests do.
#![allow(clippy::unwrap_used)]

#[path = "../../../../tests/harness/data.rs"]
mod data;

mod commands;
mod radiance;
mod stability;
mod trust;
