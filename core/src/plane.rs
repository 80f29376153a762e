//! One channel of an interleaved image as a dense plane, and where a sample lies.

use ndarray::ArrayView3;

use crate::frame::{Frame, FrameError};

/// What [`Frame`]'s constructors check, for floats and for frames built by variant.
pub(crate) fn check_shape((height, width, channels): (usize, usize, usize)) -> Result<(), FrameError> {
    if height == 0 || width == 0 {
        return Err(FrameError::Empty { height, width });
    }
    if channels != 1 && channels != 3 {
        return Err(FrameError::Channels { channels });
    }
    Ok(())
}

/// (row, column, channel) of the `index`-th sample in interleaved order.
pub(crate) fn place_of(index: usize, (_, width, channels): (usize, usize, usize)) -> (usize, usize, usize) {
    (index / channels / width, index / channels % width, index % channels)
}

/// Copies one channel of `image` into `plane`, row-major.
pub(crate) fn take<T: Copy + Into<f32>>(image: ArrayView3<'_, T>, channel: usize, plane: &mut Vec<f32>) {
    let channels = image.dim().2;
    let image = image.as_standard_layout();
    plane.clear();
    if let Some(samples) = image.as_slice() {
        plane.extend(samples.iter().skip(channel).step_by(channels).map(|&sample| sample.into()));
    }
}

/// [`take`] for either depth.
pub(crate) fn take_from_frame(frame: &Frame, channel: usize, plane: &mut Vec<f32>) {
    match frame {
        Frame::U8(pixels) => take(pixels.view(), channel, plane),
        Frame::U16(pixels) => take(pixels.view(), channel, plane),
    }
}
