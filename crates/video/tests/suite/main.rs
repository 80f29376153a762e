//! Videos and live sources by ffmpeg.

#[path = "../../../../tests/harness/data.rs"]
mod data;

mod live;
mod video;
