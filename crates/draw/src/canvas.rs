//! [`Canvas`]: the shapes of a chart, before they become SVG or pixels.

use crate::font::Font;
use crate::picture::Picture;
use crate::primitives::{Area, Colour, Position, WHITE};

/// The part of a text that is at its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// An open line. `dash` is the length of its dashes; 0 draws a solid line.
    Line { points: Vec<Position>, colour: Colour, width: f32, dash: f32 },
    /// A polygon, transparent without `fill`. `edge` is the colour and the width of its outline. The SVG shows `hover` while
    /// the pointer is on it.
    Area { points: Vec<Position>, fill: Option<Colour>, edge: (Colour, f32), hover: String },
    /// An image that fills `area`.
    Picture { area: Area, picture: Picture },
    /// A text of length `width` px whose baseline is at `position`, upwards or horizontal.
    Text {
        position: Position,
        text: String,
        size: f32,
        colour: Colour,
        anchor: Anchor,
        is_upwards: bool,
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

    /// Adds a filled rectangle.
    pub fn block(&mut self, (left, top, right, bottom): Area, colour: Colour) {
        let points = vec![(left, top), (right, top), (right, bottom), (left, bottom)];
        let (fill, edge, hover) = (Some(colour), (WHITE, 1.0), String::new());
        self.shapes.push(Shape::Area { points, fill, edge, hover });
    }

    pub fn text(&mut self, position: Position, text: &str, size: f32, colour: Colour, anchor: Anchor) {
        self.turned(position, text, size, colour, (anchor, false));
    }

    pub fn turned(
        &mut self,
        position: Position,
        text: &str,
        size: f32,
        colour: Colour,
        (anchor, is_upwards): (Anchor, bool),
    ) {
        let width = self.font.width(text, size);
        self.shapes.push(Shape::Text {
            position,
            text: text.to_owned(),
            size,
            colour,
            anchor,
            is_upwards,
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
