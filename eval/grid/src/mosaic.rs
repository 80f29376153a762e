//! Joins several images into one, in two columns with a white line between them.

use modulo_core::Frame;
use ndarray::{Array3, s};

/// Width of the line, px.
const GAP: usize = 4;

/// Joins `frames` row by row. `None` without frames, or if one is not 8-bit RGB of the size of the first.
pub fn mosaic(frames: &[&Frame]) -> Option<Frame> {
    let (height, width, channels) = frames.first()?.dim();
    let rows = frames.len().div_ceil(2);
    let size = (rows * (height + GAP) - GAP, 2 * width + GAP, 3);
    let mut picture = Array3::from_elem(size, u8::MAX);
    for (index, frame) in frames.iter().enumerate() {
        let pixels = frame.as_u8()?;
        if frame.dim() != (height, width, 3) || channels != 3 {
            return None;
        }
        let (top, left) = ((index / 2) * (height + GAP), (index % 2) * (width + GAP));
        picture.slice_mut(s![top..top + height, left..left + width, ..]).assign(pixels);
    }
    Frame::from_u8(picture).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(value: u8) -> Frame {
        Frame::from_u8(Array3::from_elem((2, 3, 3), value)).expect("a frame")
    }

    #[test]
    fn four_frames_are_two_rows_with_a_line_between() {
        let frames = [1, 2, 3, 4].map(plain);
        let picture = mosaic(&frames.each_ref()).expect("a picture");
        let picture = picture.as_u8().expect("8 bits");
        assert_eq!(picture.dim(), (2 + GAP + 2, 3 + GAP + 3, 3));
        let corners = [picture[(0, 0, 0)], picture[(0, 3 + GAP, 0)], picture[(2 + GAP, 0, 0)]];
        assert_eq!((corners, picture[(0, 3, 0)]), ([1, 2, 3], 255));
    }

    #[test]
    fn frames_that_do_not_fit_give_none() {
        let small = Frame::from_u8(Array3::zeros((1, 1, 3))).expect("a frame");
        assert_eq!(mosaic(&[&plain(1), &small]), None);
        assert_eq!(mosaic(&[]), None);
    }
}
