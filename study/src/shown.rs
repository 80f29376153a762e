//! The 8-bit samples of a frame, as the metrics compare them.

use modulo_core::{Frame, Samples};
use ndarray::Array3;

/// The samples of an ideal or toned picture.
pub(crate) fn shown(frame: Frame) -> Array3<u8> {
    match frame.into_samples() {
        Samples::U8(samples) => samples,
        Samples::U16(_) | Samples::F32(_) => unreachable!("ideal and toned pictures have 8 bits"),
    }
}
