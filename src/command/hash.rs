//! `--hash`: what all keys of this process carry for the hash of a type.

use std::sync::OnceLock;

use anyhow::anyhow;
use clap::ValueEnum;
use modulo_runtime::transport::keys::Hashes;

use super::usage;
use crate::Failure;
use crate::cli::Hash;

/// The same for processes that take no option, such as the nodes of a launch.
pub const VARIABLE: &str = "MODULO_TYPE_HASH";

static CHOSEN: OnceLock<Hashes> = OnceLock::new();

/// Chooses for the whole process, whatever the environment says. The first
/// choice stays.
pub fn choose(hash: Hash) {
    // Fails only when the option was given twice.
    let _ = CHOSEN.set(hashes(hash));
}

/// What was chosen, or what the environment says.
pub fn chosen() -> Result<Hashes, Failure> {
    match (CHOSEN.get(), std::env::var(VARIABLE)) {
        (Some(chosen), _) => Ok(*chosen),
        (None, Ok(text)) if !text.is_empty() => parse(&text).map(hashes),
        (None, _) => Ok(Hashes::default()),
    }
}

fn hashes(hash: Hash) -> Hashes {
    match hash {
        Hash::Rihs01 => Hashes::Rihs01,
        Hash::None => Hashes::None,
    }
}

/// The word for it.
pub fn word(hashes: Hashes) -> &'static str {
    match hashes {
        Hashes::Rihs01 => "rihs01",
        Hashes::None => "none",
    }
}

/// Reads the word for it.
pub fn parse(text: &str) -> Result<Hash, Failure> {
    Hash::from_str(text, false).map_err(|_| usage(anyhow!("'{text}' is no hash: rihs01 and none are")))
}
