//! [`warn_once`]: a warning that several nodes of a process would repeat.

use std::sync::{Mutex, PoisonError};

/// The warnings so far, at most [`MOST_KEPT`] of them: a peer that sets parameters must not fill the memory.
static WARNED: Mutex<Vec<String>> = Mutex::new(Vec::new());
const MOST_KEPT: usize = 64;

/// Logs a warning, unless the same text was among the last 64 different ones of this process.
pub fn warn_once(text: String) {
    let mut warned = WARNED.lock().unwrap_or_else(PoisonError::into_inner);
    if warned.contains(&text) {
        return;
    }
    tracing::warn!("{text}");
    if warned.len() == MOST_KEPT {
        warned.remove(0);
    }
    warned.push(text);
}
