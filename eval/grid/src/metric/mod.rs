//! The metrics of detections, one file each. The reports print the definition of each metric.

pub mod average;
pub mod bootstrap;
pub mod latency;
pub mod matching;
pub mod paper;
