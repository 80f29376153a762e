//! Evaluation in lockstep: every frame of a source goes once, in order, through the same nodes as in a live run, and the
//! detected boxes are scored against the ground truth.
//!
//! There are two kinds: the nodes of a launch file ([`launch_file`]), and a [`grid`] of settings over labelled frames,
//! whose results are stored ([`store`]), drawn ([`chart`]) and reported ([`report`]). Nothing here uses a transport. The
//! same frames and parameters give the same files, except for durations.

pub mod budget;
pub mod chart;
pub mod classes;
pub mod data;
mod error;
pub mod grid;
mod labels;
pub mod launch_file;
pub mod metric;
mod pareto;
mod published;
pub mod report;
pub mod results;
pub mod store;
mod timeline;
