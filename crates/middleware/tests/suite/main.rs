//! The drivers on a transport, and the bytes on the wire.

#[path = "../../../../tests/harness/live.rs"]
mod harness;

mod drivers;
mod golden_wire;
