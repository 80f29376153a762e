//! Lines: unwrap the gradient before the image, along lines, in integers.
//!
//! Itoh asks that neighbours differ by less than half a peak; here only *mixed*
//! differences have to (P = 2^b):
//! ```text
//! g = M_b(d_x y),   d_x x = g + n P,   d_y n = (M_b(d_y g) - d_y g) / P   if |d_x d_y x| < P/2
//! ```
//! 1. `gradient`: n down each column; most of a column is flat, which gives its constant.
//! 2. `rows`: sums along each row, rows joined by what most of their columns say.
//! 3. The absolute offset, as every method has it.
//!
//! Exact when `|d_x d_y x| < P/2` everywhere and, in each column and row, most
//! differences to the neighbour are below P/2 -- or, where an edge runs along most of
//! a line, `|d_x d_x x|` and `|d_y d_y x| < P/2` along most of it. It fails on
//! what a sharp lens shows: an edge of more than P/2 that ends within the image breaks the
//! condition at its end, and the error runs along the line. Hot pixels leave streaks.

mod gradient;
mod majority;
mod rows;

use super::{Range, Recovered, Unwrap, UnwrapError, check_frame, congruence, wrapped};
use crate::frame::Frame;
use crate::plane;

/// The method with its buffers; each channel on its own, O(pixels).
#[derive(Default)]
pub struct Lines {
    y: Vec<f32>,
    codes: Vec<u16>,
    gradient: gradient::Gradient,
    rows: rows::Rows,
}

impl Unwrap for Lines {
    fn name(&self) -> &'static str {
        "lines"
    }

    fn unwrap(&mut self, y: &Frame, range: Range, out: &mut Recovered) -> Result<(), UnwrapError> {
        check_frame(y, range)?;
        out.prepare(y.dim(), self.name());
        let (_, width, channels) = y.dim();
        for channel in 0..channels {
            plane::take_from_frame(y, channel, &mut self.y);
            wrapped::codes(&self.y, range, &mut self.codes);
            let n = self.gradient.unwrap(&self.codes, width, range);
            let k = self.rows.integrate(&self.codes, n, width, range);
            congruence::place(k, &self.y, range, channel, out);
        }
        Ok(())
    }
}
