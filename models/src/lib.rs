//! Detection models: where official exports come from, and how to fetch them.
//!
//! Nothing is fetched that was not asked for by name, and no byte is kept that
//! was not checked against a sha256. Models are files here: nothing is run.

/// The embedded demonstration detector, ONNX: trained by this project on its own
/// scenes alone. Its card is `models/README.md`.
pub const DEMO: &[u8] = include_bytes!("../demo.onnx");

mod fetch;
mod official;
mod part;

pub use fetch::{FetchError, Fetched, LIMIT, Request, fetch};
pub use official::{LICENCE, OFFICIAL, Official, OfficialError, official};
