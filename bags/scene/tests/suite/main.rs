//! Exactness and robustness on rendered scenes.

// Helpers of tests may unwrap as tests do.
#![allow(clippy::unwrap_used)]

#[path = "../../../../tests/harness/data.rs"]
mod data;

mod exactness;
mod robustness;
