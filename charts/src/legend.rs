//! The legend below the panels, in columns.

use crate::canvas::{Anchor, Canvas, INK, Spot};
use crate::style::Style;
use crate::{Look, Tone};

const SIZE: f32 = 12.5;
const LINE: f32 = 20.0;
/// Length of the piece of line, px.
const SWATCH: f32 = 34.0;

/// Draws the names in their styles; returns the y after them.
pub fn draw(canvas: &mut Canvas, names: &[(&str, Look)], (left, top): Spot) -> f32 {
    let widest = names.iter().map(|(name, _)| canvas.font.width(name, SIZE)).fold(0.0, f32::max);
    let column = widest + SWATCH + 36.0;
    let columns = (((canvas.width - 2.0 * left) / column) as usize).clamp(1, names.len().max(1));
    for (index, (name, look)) in names.iter().enumerate() {
        let x = left + column * (index % columns) as f32;
        let y = top + LINE * (index / columns) as f32;
        let style = Style::of(index);
        if *look != Look::Marks {
            style.line(canvas, vec![(x, y), (x + SWATCH, y)]);
        }
        if *look != Look::Line {
            style.mark(canvas, (x + SWATCH / 2.0, y), Tone::Full, "");
        }
        canvas.text((x + SWATCH + 8.0, y + SIZE * 0.36), name, SIZE, INK, Anchor::Start);
    }
    top + LINE * names.len().div_ceil(columns) as f32
}
