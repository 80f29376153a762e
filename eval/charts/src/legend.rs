//! The legend below the panels, in columns.

use crate::canvas::{Anchor, Canvas, INK, Spot};
use crate::series::{Look, Tone};
use crate::style::Style;

const SIZE: f32 = 12.5;
const LINE: f32 = 20.0;
/// Length of the piece of line, px.
const SWATCH: f32 = 34.0;
/// Half a side of a filled area, px.
const BLOCK: f32 = 6.5;

/// What a name stands beside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Swatch {
    /// As the series is drawn.
    Series(Look),
    /// A filled area.
    Block,
}

impl Swatch {
    fn draw(self, canvas: &mut Canvas, style: &Style, (x, y): Spot) {
        if matches!(self, Self::Series(Look::Joined | Look::Line)) {
            style.line(canvas, vec![(x, y), (x + SWATCH, y)]);
        }
        if matches!(self, Self::Series(Look::Joined | Look::Marks)) {
            style.mark(canvas, (x + SWATCH / 2.0, y), Tone::Full, "");
        }
        if self == Self::Block {
            let area = (x + SWATCH / 2.0 - BLOCK, y - BLOCK, x + SWATCH / 2.0 + BLOCK, y + BLOCK);
            canvas.block(area, style.colour, "");
        }
    }
}

/// Draws the names in their styles; returns the y after them.
pub fn draw(canvas: &mut Canvas, names: &[(&str, Swatch)], (left, top): Spot) -> f32 {
    if names.is_empty() {
        return top;
    }
    let widest = names.iter().map(|(name, _)| canvas.font.width(name, SIZE)).fold(0.0, f32::max);
    let column = widest + SWATCH + 36.0;
    let columns = (((canvas.width - 2.0 * left) / column) as usize).clamp(1, names.len().max(1));
    for (index, (name, swatch)) in names.iter().enumerate() {
        let x = left + column * (index % columns) as f32;
        let y = top + LINE * (index / columns) as f32;
        swatch.draw(canvas, &Style::of(index), (x, y));
        canvas.text((x + SWATCH + 8.0, y + SIZE * 0.36), name, SIZE, INK, Anchor::Start);
    }
    top + LINE * names.len().div_ceil(columns) as f32
}
