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
