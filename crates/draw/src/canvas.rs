//! [`Canvas`]: the shapes of a chart as SVG 1.1.

use std::fmt::Write as _;

use crate::font::Font;
use crate::primitives::{Colour, Position, WHITE};

/// The part of a text that is at its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
    /// The middle of a text that is written upwards.
    Upwards,
}

/// A touch gives the focus to a mark, whose text is shown then.
const TIPS: &str = ".tip { display: none; stroke: #fff; stroke-width: 4px; paint-order: stroke; } \
                    .mark { outline: none; } .mark:focus + .tip { display: block; }";

/// The size of its text.
const TIP_SIZE: f32 = 11.0;

/// A white page with shapes, drawn from first to last.
pub struct Canvas {
    pub width: f32,
    pub height: f32,
    pub font: Font,
    /// An element of SVG a line.
    shapes: String,
}

impl Canvas {
    pub fn new(width: f32, font: Font) -> Self {
        Self { width, height: 0.0, font, shapes: String::new() }
    }

    /// The page as an SVG document; `name` is read in its place to those who do not see it.
    pub fn document(&self, name: &str) -> String {
        let Self { width, height, shapes, .. } = self;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"DejaVu Sans, Verdana, sans-serif\" role=\"img\" aria-label=\"{}\">\n\
             <style>{TIPS}</style>\n<rect width=\"100%\" height=\"100%\" fill=\"{}\"/>\n{shapes}</svg>\n",
            escaped(name),
            hex(WHITE)
        )
    }

    fn push(&mut self, element: std::fmt::Arguments<'_>) {
        // Writing to a String cannot fail.
        let _ = writeln!(self.shapes, "{element}");
    }

    /// Adds an open line. `dash` is the length of its dashes; 0 draws a solid line.
    pub fn line(&mut self, points: &[Position], colour: Colour, width: f32, dash: f32) {
        let dash = if dash > 0.0 { format!(" stroke-dasharray=\"{dash}\"") } else { String::new() };
        let (points, colour) = (coordinates(points), hex(colour));
        self.push(format_args!(
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\"{dash}/>"
        ));
    }

    /// Adds a polygon, transparent without `fill`. `edge` is the colour and the width of its outline. `hover` is shown while the pointer is
    /// on it, and after a touch.
    pub fn area(&mut self, points: &[Position], fill: Option<Colour>, edge: (Colour, f32), hover: &str) {
        let fill = fill.map_or_else(|| "none\" pointer-events=\"all".to_owned(), hex);
        let (places, colour, width) = (coordinates(points), hex(edge.0), edge.1);
        let shape =
            format!("points=\"{places}\" fill=\"{fill}\" stroke=\"{colour}\" stroke-width=\"{width}\"");
        let Some(&(x, y)) = points.first().filter(|_| !hover.is_empty()) else {
            return self.push(format_args!("<polygon {shape}/>"));
        };
        // Beside the mark, but within the page.
        let width = self.font.width(hover, TIP_SIZE);
        let (x, y) = ((x - width / 2.0).min(self.width - width - 4.0).max(4.0), y - 8.0);
        let hover = escaped(hover);
        self.push(format_args!(
            "<polygon {shape} class=\"mark\" tabindex=\"-1\"><title>{hover}</title></polygon>"
        ));
        self.push(format_args!(
            "<text class=\"tip\" x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{TIP_SIZE}\">{hover}</text>"
        ));
    }

    /// Adds a text whose baseline is at the position.
    pub fn text(&mut self, (x, y): Position, text: &str, size: f32, colour: Colour, anchor: Anchor) {
        let (anchor, rotation) = match anchor {
            Anchor::Start => ("start", String::new()),
            Anchor::Middle => ("middle", String::new()),
            Anchor::End => ("end", String::new()),
            Anchor::Upwards => ("middle", format!(" transform=\"rotate(-90 {x:.1} {y:.1})\"")),
        };
        let (colour, width, text) = (hex(colour), self.font.width(text, size), escaped(text));
        // `textLength` makes the browser stretch the text to the width that the layout assumed. Without it, another
        // font than DejaVu Sans would make labels cover each other.
        self.push(format_args!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" fill=\"{colour}\" text-anchor=\"{anchor}\" \
             textLength=\"{width:.1}\" lengthAdjust=\"spacingAndGlyphs\"{rotation}>{text}</text>"
        ));
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

fn coordinates(points: &[Position]) -> String {
    points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
}

fn hex([r, g, b]: Colour) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn escaped(text: &str) -> String {
    // The ampersand comes first: later it would also replace those of the other entities.
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
