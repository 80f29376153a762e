//! Detection models: where official exports come from, and how to fetch them.
//!
//! A model is fetched only when its name is given, and kept only when its sha256 is right. Models are files here: no
//! model is run.

/// The embedded demonstration detector, ONNX, trained by this project on its own scenes only. Its card is
/// `models/README.md`.
pub const DEMO: &[u8] = include_bytes!("../demo.onnx");

mod fetch;
mod official;

pub use fetch::{FetchError, FetchRequest, Fetched, LIMIT, fetch, hex};
pub use official::{LICENCE, OFFICIAL, Official, OfficialError, official};
