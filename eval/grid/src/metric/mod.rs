//! The metrics of detections, one file each. The reports print the definition of each metric.

pub mod average;
pub mod average_precision;
pub mod bootstrap;
pub mod difficulty;
pub mod latency;
pub mod matching;
pub mod paper;
