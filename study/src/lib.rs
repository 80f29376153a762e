//! What the unwrapping methods do with pictures: one's own, a folder of frames,
//! and the scenes on which methods fail.
//!
//! Nothing here knows a node, a message or a topic; every figure is measured on
//! the same `core` that the nodes run.
