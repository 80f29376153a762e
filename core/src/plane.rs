//! One channel of an interleaved image as a dense plane, and where a sample lies.

/// (row, column, channel) of the `index`-th sample in interleaved order.
pub(crate) fn place_of(index: usize, (_, width, channels): (usize, usize, usize)) -> (usize, usize, usize) {
    (index / channels / width, index / channels % width, index % channels)
}

/// Copies one channel of `samples`, interleaved, into `plane`, row-major.
pub(crate) fn take<T: Copy + Into<f32>>(
    samples: &[T],
    channels: usize,
    channel: usize,
    plane: &mut Vec<f32>,
) {
    plane.clear();
    plane.extend(samples.iter().skip(channel).step_by(channels).map(|&sample| sample.into()));
}
