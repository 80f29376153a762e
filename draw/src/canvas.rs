//! [`Canvas`]: the shapes of a chart, before they become SVG or pixels.

use ab_glyph::{Font as _, FontRef, GlyphId, OutlineCurve};
use tiny_skia::{Path, PathBuilder};

use crate::picture::Picture;
use crate::primitives::{Area, Colour, Position, WHITE};

/// The part of a text that is at its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// Direction of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rotation {
    Horizontal,
    Upwards,
}

/// A shape.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// An open line. `dash` is the length of its dashes; 0 draws a solid line.
    Line { points: Vec<Position>, colour: Colour, width: f32, dash: f32 },
    /// A polygon, transparent without `fill`. `edge` is the colour and the width of its outline. The SVG shows `hover` while
    /// the pointer is on it.
    Area { points: Vec<Position>, fill: Option<Colour>, edge: (Colour, f32), hover: String },
    /// An image that fills `area`.
    Picture { area: Area, picture: Picture },
    /// A text of length `width` px whose baseline is at `position`.
    Text {
        position: Position,
        text: String,
        size: f32,
        colour: Colour,
        anchor: Anchor,
        rotation: Rotation,
        width: f32,
    },
}

/// A white page with shapes, drawn from first to last.
pub struct Canvas {
    pub width: f32,
    pub height: f32,
    pub shapes: Vec<Shape>,
    pub font: Font,
}

impl Canvas {
    pub fn new(width: f32, font: Font) -> Self {
        Self { width, height: 0.0, shapes: Vec::new(), font }
    }

    pub fn line(&mut self, points: Vec<Position>, colour: Colour, width: f32) {
        self.shapes.push(Shape::Line { points, colour, width, dash: 0.0 });
    }

    /// Adds a filled rectangle. The SVG shows `hover` while the pointer is on it.
    pub fn block(&mut self, (left, top, right, bottom): Area, colour: Colour, hover: &str) {
        let points = vec![(left, top), (right, top), (right, bottom), (left, bottom)];
        self.shapes.push(Shape::Area {
            points,
            fill: Some(colour),
            edge: (WHITE, 1.0),
            hover: hover.to_owned(),
        });
    }

    pub fn text(&mut self, position: Position, text: &str, size: f32, colour: Colour, anchor: Anchor) {
        self.turned(position, text, size, colour, (anchor, Rotation::Horizontal));
    }

    pub fn turned(
        &mut self,
        position: Position,
        text: &str,
        size: f32,
        colour: Colour,
        (anchor, rotation): (Anchor, Rotation),
    ) {
        let width = self.font.width(text, size);
        self.shapes.push(Shape::Text {
            position,
            text: text.to_owned(),
            size,
            colour,
            anchor,
            rotation,
            width,
        });
    }

    /// Adds `text` in lines up to the right margin. Returns the y below it.
    pub fn paragraph(&mut self, (x, mut y): Position, text: &str, size: f32, colour: Colour) -> f32 {
        for line in self.font.wrap(text, size, self.width - 2.0 * x) {
            self.text((x, y), &line, size, colour, Anchor::Start);
            y += size * 1.45;
        }
        y
    }
}

/// The typeface of all charts and images, DejaVu Sans. It is embedded in the program, so that text has the same width on every
/// machine.
pub struct Font(FontRef<'static>);

impl Font {
    pub fn new() -> Self {
        let bytes = include_bytes!("../font/DejaVuSans.ttf");
        Self(FontRef::try_from_slice(bytes).expect("the embedded file is a valid font"))
    }

    /// Width of `text` in px at font size `size` px.
    pub fn width(&self, text: &str, size: f32) -> f32 {
        text.chars().map(|c| self.advance(self.0.glyph_id(c), size)).sum()
    }

    /// The outlines of `text` with its baseline starting at (0, 0). `None` if the text has no visible glyph.
    pub fn path(&self, text: &str, size: f32) -> Option<Path> {
        let (mut builder, mut x) = (PathBuilder::new(), 0.0);
        for glyph in text.chars().map(|c| self.0.glyph_id(c)) {
            if let Some(outline) = self.0.outline(glyph) {
                trace(&mut builder, &outline.curves, x, self.scale(size));
            }
            x += self.advance(glyph, size);
        }
        builder.finish()
    }

    /// Breaks `text` at spaces into lines of at most `width` px. A longer word gets a line of its own.
    pub fn wrap(&self, text: &str, size: f32, width: f32) -> Vec<String> {
        let mut lines: Vec<String> = Vec::new();
        for word in text.split_whitespace() {
            match lines.last_mut() {
                Some(line) if self.width(&format!("{line} {word}"), size) <= width => {
                    line.push(' ');
                    line.push_str(word);
                }
                _ => lines.push(word.to_owned()),
            }
        }
        lines
    }

    fn advance(&self, glyph: GlyphId, size: f32) -> f32 {
        self.0.h_advance_unscaled(glyph) * self.scale(size)
    }

    /// Pixels of one font unit.
    fn scale(&self, size: f32) -> f32 {
        size / self.0.units_per_em().expect("the embedded font has its units")
    }
}

/// Adds the outline of a glyph, in font units with y upwards, to a path in px with y downwards.
fn trace(builder: &mut PathBuilder, curves: &[OutlineCurve], x: f32, scale: f32) {
    let at = |p: &ab_glyph::Point| (x + p.x * scale, -p.y * scale);
    let mut last = None;
    for curve in curves {
        let (OutlineCurve::Line(start, end)
        | OutlineCurve::Quad(start, _, end)
        | OutlineCurve::Cubic(start, _, _, end)) = curve;
        // Each contour is closed, so that a curve that starts elsewhere starts the next one.
        if last != Some(start) {
            let (x, y) = at(start);
            builder.move_to(x, y);
        }
        let (x, y) = at(end);
        match curve {
            OutlineCurve::Line(..) => builder.line_to(x, y),
            OutlineCurve::Quad(_, p, _) => builder.quad_to(at(p).0, at(p).1, x, y),
            OutlineCurve::Cubic(_, p, q, _) => builder.cubic_to(at(p).0, at(p).1, at(q).0, at(q).1, x, y),
        }
        last = Some(end);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_hold_all_words_and_fit() {
        let font = Font::new();
        let text = "a few words of which one is unreasonablylongandunbreakable and α ends";
        let lines = font.wrap(text, 12.0, 90.0);
        assert_eq!(lines.join(" "), text);
        assert!(lines.iter().all(|line| font.width(line, 12.0) <= 90.0 || !line.contains(' ')));
        assert!(lines.len() > 3, "{lines:?}");
    }
}
