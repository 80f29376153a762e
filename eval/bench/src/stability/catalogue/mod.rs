//! The catalogue: scenes that are hard for some methods, with the expected results. One file for each kind of scene.

mod bright;
mod edges;
mod sensors;
mod slopes;
mod uneven;

use super::case::Case;

/// Methods that solve a Poisson equation: a wrong difference distorts its surroundings.
const LEAST_SQUARES: &[&str] = &["spud", "least_squares"];

/// Methods that use only first differences.
const FIRST_ORDER: &[&str] = &["spud", "least_squares", "itoh", "tree", "quality_guided"];

/// Methods that unwrap reliable pixels first, so that errors stay local.
const SORTED: &[&str] = &["tree", "quality_guided"];

/// The reason why methods that use only first differences fail behind a soft but high edge.
const RIM: &str = "first differences exceed half a peak on the edge and are taken for small ones";

/// All cases, in the order of [`Family`](super::case::Family).
pub fn cases() -> Vec<Case> {
    [edges::cases(), bright::cases(), slopes::cases(), uneven::cases(), sensors::cases()]
        .into_iter()
        .flatten()
        .collect()
}
