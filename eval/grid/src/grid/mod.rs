//! A grid of evaluations: every combination of stream, method, lens, alpha, noise, model and input size over the same
//! labelled frames.
//!
//! The data go one way:
//!
//! ```text
//! request -> cells -> frames -> pipeline (sensor, unwrapping) -> detect -> score -> timing -> store -> report
//! ```
//!
//! `run` goes over the cells and stores the results after each of them, `runner` processes the frames of one cell, and
//! `timing` measures the times of all cells at the end. The figures of a cell do not depend on other cells: finished cells
//! are kept, and a run that was killed continues. No transport is used. The clock only measures
//! durations; it decides nothing.

mod around;
mod cells;
mod combinations;
mod detect;
mod detection_pictures;
mod frames;
mod listing;
mod pipeline;
mod request;
mod run;
mod runner;
mod score;
mod timing;

pub use crate::GridError;
pub use cells::{Axes, DeblurChoice};
pub use detection_pictures::draw_pictures;
pub use pipeline::multi_exposure::CAPTURES;
pub use pipeline::{MakeDetector, detector};
pub use request::{Data, GridEvent, GridOptions, Request, words};
pub use run::run;
