//! Average precision (AP) of detected boxes, as COCO and KITTI define it.

pub mod average;
pub mod difficulty;
pub mod matching;

pub use difficulty::Difficulty;
