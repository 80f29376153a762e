//! The methods, the sensor and the metrics against their definitions and against references.

// Helpers of tests may unwrap as tests do.
#![allow(clippy::unwrap_used)]

#[path = "../../../../tests/harness/data.rs"]
mod data;

mod lines;
mod references;
mod sensor;
mod unwrap;
