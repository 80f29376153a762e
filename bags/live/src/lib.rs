//! Bags beside a running suite: topics are recorded into a bag, and a bag is played on topics.
//!
//! ```text
//! topics -> capture -> bag         bag -> play -> replay -> topics
//! ```
//!
//! Nothing here reads a clock of its own or knows of any node: `capture` and `replay` are lent a transport and a clock.

pub mod capture;
pub mod control;
pub mod play;
pub mod remap;
pub mod replay;

use modulo_bags::bag::BagError;
use modulo_middleware::transport::TransportError;

/// Error: a recording or a replay failed.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The bag cannot be read or written.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// The transport failed.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// Nodes that should listen are not ready.
    #[error("waited {0} s for {1}, which is not there; start it, or leave --wait-for out")]
    Waited(u64, String),
}
