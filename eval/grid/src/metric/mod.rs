//! How good detections are: one file a metric, each with its definition in words, which reports print.

pub mod average;
pub mod average_precision;
pub mod bootstrap;
pub mod difficulty;
pub mod latency;
pub mod matching;
pub mod paper;
