//! Detection models: where official exports come from, and how to fetch them.
//!
//! Nothing is fetched that was not asked for by name, and no byte is kept that
//! was not checked against a sha256. Models are files here: nothing is run.

mod fetch;
mod official;
mod part;

pub use fetch::{FetchError, Fetched, LIMIT, Request, fetch};
pub use official::{LICENCE, OFFICIAL, Official, OfficialError, official};
