//! A grid of evaluations: every combination of stream, method, lens, alpha, noise, model and input size over the same
//! labelled frames.
//!
//! The modules are the steps of a run in their order: a [`Request`] gives the cells, each frame of a cell goes through
//! a pipeline (sensor and unwrapping) and a detector, and the scores of the cell are stored. Cells are independent of
//! each other: finished cells are kept, a run that was killed continues, and [`merge`] joins shards. No transport is
//! used, and the clock only measures durations; it decides nothing.

mod request;

mod cells;

mod frames;
mod neighbours;

mod pipeline;

mod detect;
mod nodes;

mod runner;
mod setup;

mod score;

mod merge;
mod pictures;
mod run;

pub use crate::error::GridError;
pub use cells::{Axes, Deblur};
pub use merge::merge;
pub use nodes::{Nodes, Suite};
pub use pictures::draw_pictures;
pub use pipeline::multi_exposure::CAPTURES;
pub use request::{Options, Request, Shard, engine_parser};
pub use run::{Event, Outcome, run};
