//! The catalogue: the scenes on which methods fail, or are known not to, and what is expected.
//!
//! One file a kind of scene. A scene is a table row: generators, sensor, expectations.

mod bright;
mod edges;
mod sensors;
mod slopes;
mod uneven;

use super::case::Case;

/// Solve one Poisson equation: a wrong difference bends everything around it.
const LEAST_SQUARES: &[&str] = &["spud", "least_squares"];

/// Follow first differences alone, in one order or another.
const FIRST_ORDER: &[&str] = &["spud", "least_squares", "itoh", "tree", "quality_guided"];

/// Order their steps, so that an error stays where it is.
const SORTED: &[&str] = &["tree", "quality_guided"];

/// Why methods of first order lose what is behind a soft but high edge.
const RIM: &str = "first differences exceed half a peak on the edge and are taken for small ones";

/// All cases, in the order of [`Family`](super::case::Family).
pub fn cases() -> Vec<Case> {
    [edges::cases(), bright::cases(), slopes::cases(), uneven::cases(), sensors::cases()]
        .into_iter()
        .flatten()
        .collect()
}
