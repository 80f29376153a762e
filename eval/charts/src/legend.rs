//! The legend below the panels, in columns.

use crate::canvas::{Anchor, Canvas};
use crate::primitives::{Colour, INK, Position};
use crate::series::{Emphasis, SeriesStyle};
use crate::style::Style;

const SIZE: f32 = 12.5;
const LINE: f32 = 20.0;
/// Width of a key, px.
const KEY_WIDTH: f32 = 34.0;
/// Half a side of a filled area, px.
const BLOCK: f32 = 6.5;

/// The symbol beside a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LegendKey {
    /// The style of a series.
    Series(SeriesStyle),
    /// A filled square.
    Block,
    /// A filled square of this colour.
    Colour(Colour),
}

impl LegendKey {
    fn draw(self, canvas: &mut Canvas, style: &Style, (x, y): Position) {
        if matches!(self, Self::Series(SeriesStyle::LineAndMarkers | SeriesStyle::Line)) {
            style.line(canvas, vec![(x, y), (x + KEY_WIDTH, y)]);
        }
        if matches!(self, Self::Series(SeriesStyle::LineAndMarkers | SeriesStyle::Markers)) {
            style.mark(canvas, (x + KEY_WIDTH / 2.0, y), Emphasis::Normal, "");
        }
        let colour = match self {
            Self::Series(_) => return,
            Self::Block => style.colour,
            Self::Colour(colour) => colour,
        };
        let area = (x + KEY_WIDTH / 2.0 - BLOCK, y - BLOCK, x + KEY_WIDTH / 2.0 + BLOCK, y + BLOCK);
        canvas.block(area, colour, "");
    }
}

/// Draws the names with their keys. Returns the y below them.
pub fn draw(canvas: &mut Canvas, names: &[(&str, LegendKey)], (left, top): Position) -> f32 {
    if names.is_empty() {
        return top;
    }
    let widest = names.iter().map(|(name, _)| canvas.font.width(name, SIZE)).fold(0.0, f32::max);
    let column = widest + KEY_WIDTH + 36.0;
    let columns = (((canvas.width - 2.0 * left) / column) as usize).clamp(1, names.len().max(1));
    for (index, (name, key)) in names.iter().enumerate() {
        let x = left + column * (index % columns) as f32;
        let y = top + LINE * (index / columns) as f32;
        key.draw(canvas, &Style::of(index), (x, y));
        canvas.text((x + KEY_WIDTH + 8.0, y + SIZE * 0.36), name, SIZE, INK, Anchor::Start);
    }
    top + LINE * names.len().div_ceil(columns) as f32
}
