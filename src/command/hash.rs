//! `--hash`: the form of type hashes in all keys of this process.

use std::sync::OnceLock;

use anyhow::anyhow;
use modulo_runtime::transport::keys::Hashes;

use super::usage;
use crate::Failure;

/// The environment variable for processes that take no option, such as the nodes of a launch.
pub const VARIABLE: &str = "MODULO_TYPE_HASH";

static CHOSEN: OnceLock<Hashes> = OnceLock::new();

/// Chooses for the whole process, regardless of the environment. The first choice stays.
pub fn choose(hashes: Hashes) {
    // Fails only when the option was given twice.
    let _ = CHOSEN.set(hashes);
}

/// Returns the choice, or the value of the environment variable.
pub fn chosen() -> Result<Hashes, Failure> {
    match (CHOSEN.get(), std::env::var(VARIABLE)) {
        (Some(chosen), _) => Ok(*chosen),
        (None, Ok(text)) if !text.is_empty() => parse(&text),
        (None, _) => Ok(Hashes::default()),
    }
}

/// Reads the word of the option.
pub fn parse(text: &str) -> Result<Hashes, Failure> {
    let found = Hashes::WORDS.into_iter().find(|(word, _)| *word == text);
    found
        .map(|(_, hashes)| hashes)
        .ok_or_else(|| usage(anyhow!("'{text}' is not a form of type hashes: rihs01 and none are possible")))
}
