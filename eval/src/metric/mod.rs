//! What is counted, one file a metric.

pub mod average_precision;
