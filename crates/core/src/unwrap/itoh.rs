//! Itoh's method: it follows the wrapped differences down the first column, then along each row. One difference
//! of half a peak or more spoils the rest of its row.

use super::{Integers, Recovered, Scene, Unwrap, UnwrapError, congruence};
use crate::frame::Frame;
use crate::gradient::wrap_step;

/// Path integration with its buffers, one channel after the other, in integers.
#[derive(Default)]
pub struct Itoh {
    y: Vec<f32>,
    k: Vec<i32>,
    levels: Vec<usize>,
}

impl Unwrap for Itoh {
    fn name(&self) -> &'static str {
        "itoh"
    }

    fn unwrap(&mut self, y: &Frame, scene: &Scene, out: &mut Recovered) -> Result<(), UnwrapError> {
        let range = scene.range;
        let samples = Integers::checked(y, range)?;
        out.prepare(y.dim(), self.name());
        let (_, width, channels) = y.dim();
        for channel in 0..channels {
            samples.take(channels, channel, &mut self.y);
            integrate(&self.y, width, range.bits(), &mut self.k);
            congruence::write_channel(&self.k, &self.y, range, channel, &mut self.levels, out);
        }
        Ok(())
    }
}

/// Writes to `k` the wrap counts of `y` relative to its first pixel.
fn integrate(y: &[f32], width: usize, bits: u8, k: &mut Vec<i32>) {
    k.clear();
    // Each row starts from the first column, so an error stays in its row unless it is in that column.
    let (mut first, mut above) = (0, y[0]);
    for row in y.chunks_exact(width) {
        first += wrap_step(row[0] - above, bits);
        above = row[0];
        // The first pixel is compared with itself, which adds no step and needs no special case.
        let (mut here, mut left) = (first, row[0]);
        for &value in row {
            here += wrap_step(value - left, bits);
            left = value;
            k.push(here);
        }
    }
}
