//! Videos and live sources by ffmpeg.

#[path = "../../../../tests/harness/data.rs"]
mod data;

mod broken;
mod live;
mod video;
