//! Grids and their reports; the commands on image files; the stability suite, and the trust and accuracy of the methods.

// Helpers of tests may unwrap as tests do.
#![allow(clippy::unwrap_used)]

#[path = "../../../../tests/harness/data.rs"]
mod data;

mod grid;
mod images;
mod radiance;
mod report;
mod stability;
mod trust;
