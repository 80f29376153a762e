//! The drivers on a transport, and the bytes on the wire.

#[path = "../../../../tests/harness/live.rs"]
mod harness;
#[path = "../../../../tests/harness/offered.rs"]
mod offered;

mod drivers;
mod golden_wire;
