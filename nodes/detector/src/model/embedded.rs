//! The model that is part of the program, so that a bare machine can run.

use std::path::Path;

/// What the parameter `model` calls it; a file of that name is `./demo`.
pub const DEMO: &str = "demo";

/// The bytes of `model` if it is the embedded one.
pub fn embedded(model: &Path) -> Option<&'static [u8]> {
    (model == Path::new(DEMO)).then_some(modulo_models::DEMO)
}
