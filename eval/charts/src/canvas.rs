//! [`Canvas`]: the shapes of a chart, before they are SVG or pixels.

use crate::font::Font;
use crate::label::Area;
use crate::pictures::Picture;

/// Red, green, blue.
pub type Colour = [u8; 3];

pub const INK: Colour = [0x22, 0x22, 0x22];
pub const GREY: Colour = [0x55, 0x55, 0x55];
pub const FADED: Colour = [0xbd, 0xbd, 0xbd];
pub const FAINT: Colour = [0xe4, 0xe4, 0xe4];
pub const WHITE: Colour = [0xff; 3];

/// A place in px, from the left and from the top.
pub type Spot = (f32, f32);

/// Which part of a text stands at its spot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// Which way a text runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    Level,
    Upwards,
}

/// Something to draw.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// An open line; `dash` is the length of its strokes, 0 for an unbroken one.
    Line { spots: Vec<Spot>, colour: Colour, width: f32, dash: f32 },
    /// A filled polygon with a white edge; `hover` is shown while a pointer is on it.
    Area { spots: Vec<Spot>, colour: Colour, hover: String },
    /// A picture that fills (left, top, right, bottom).
    Picture { area: Area, picture: Picture },
    /// A text whose baseline is at `spot`, `width` px long.
    Text { spot: Spot, text: String, size: f32, colour: Colour, anchor: Anchor, turn: Turn, width: f32 },
}

/// White, with shapes on it from first to last.
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

    pub fn line(&mut self, spots: Vec<Spot>, colour: Colour, width: f32) {
        self.shapes.push(Shape::Line { spots, colour, width, dash: 0.0 });
    }

    /// A filled (left, top, right, bottom); `hover` is shown while a pointer is on it.
    pub fn block(&mut self, (left, top, right, bottom): Area, colour: Colour, hover: &str) {
        let spots = vec![(left, top), (right, top), (right, bottom), (left, bottom)];
        self.shapes.push(Shape::Area { spots, colour, hover: hover.to_owned() });
    }

    pub fn text(&mut self, spot: Spot, text: &str, size: f32, colour: Colour, anchor: Anchor) {
        self.turned(spot, text, size, colour, (anchor, Turn::Level));
    }

    pub fn turned(
        &mut self,
        spot: Spot,
        text: &str,
        size: f32,
        colour: Colour,
        (anchor, turn): (Anchor, Turn),
    ) {
        let width = self.font.width(text, size);
        self.shapes.push(Shape::Text { spot, text: text.to_owned(), size, colour, anchor, turn, width });
    }

    /// Lines of `text` from `spot` to the right margin; returns the y after them.
    pub fn paragraph(&mut self, (x, mut y): Spot, text: &str, size: f32, colour: Colour) -> f32 {
        for line in self.font.wrap(text, size, self.width - 2.0 * x) {
            self.text((x, y), &line, size, colour, Anchor::Start);
            y += size * 1.45;
        }
        y
    }
}
