//! [`Event`]: what a study tells while it runs.

use serde::Serialize;

/// Handed to the caller's closure as it happens.
#[derive(Clone, Debug, PartialEq)]
pub enum Event<'a> {
    /// `done` of `total` steps are over; `next` says what comes now.
    Step {
        /// Steps that are over.
        done: usize,
        /// All steps.
        total: usize,
        /// For people: file or method, and alpha.
        next: &'a str,
    },
    /// A file was left out; the others go on.
    Skipped(&'a Skipped),
    /// A measurement to be careful with.
    Warning(&'a str),
}

/// A file that was left out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Skipped {
    /// As it was given.
    pub file: String,
    /// What was wrong with it; names the file.
    pub why: String,
}
