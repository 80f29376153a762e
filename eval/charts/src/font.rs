use tiny_skia::{Path, PathBuilder};
use ttf_parser::{Face, FaceParsingError, GlyphId, OutlineBuilder};

use crate::primitives::Position;

/// The typeface of all charts, DejaVu Sans. It is embedded in the program, so that text has the same width on every machine.
pub struct Font(Face<'static>);

impl Font {
    pub fn new() -> Result<Self, FaceParsingError> {
        Ok(Self(Face::parse(dejavu::sans::regular(), 0)?))
    }

    /// Width of `text` in px at font size `size` px.
    pub fn width(&self, text: &str, size: f32) -> f32 {
        text.chars().map(|c| self.advance(c, size)).sum()
    }

    /// The outlines of `text` with its baseline starting at (0, 0). `None` if the text has no visible glyph.
    pub fn path(&self, text: &str, size: f32) -> Option<Path> {
        let mut pen = Pen { builder: PathBuilder::new(), x: 0.0, scale: self.scale(size) };
        for c in text.chars() {
            if let Some(glyph) = self.0.glyph_index(c) {
                self.0.outline_glyph(glyph, &mut pen);
            }
            pen.x += self.advance(c, size);
        }
        pen.builder.finish()
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

    fn advance(&self, c: char, size: f32) -> f32 {
        // Glyph 0 stands for characters that the font does not contain. Their width must count, since the browser draws
        // them with another font.
        let glyph = self.0.glyph_index(c).unwrap_or(GlyphId(0));
        let advance = self.0.glyph_hor_advance(glyph).expect("every glyph of the font has an advance");
        f32::from(advance) * self.scale(size)
    }

    fn scale(&self, size: f32) -> f32 {
        size / f32::from(self.0.units_per_em().max(1))
    }
}

/// Converts glyphs in font units with y upwards to a path in px with y downwards.
struct Pen {
    builder: PathBuilder,
    x: f32,
    scale: f32,
}

impl Pen {
    fn at(&self, x: f32, y: f32) -> Position {
        (self.x + x * self.scale, -y * self.scale)
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.builder.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.builder.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.at(x1, y1), self.at(x, y));
        self.builder.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.at(x1, y1), self.at(x2, y2), self.at(x, y));
        self.builder.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.builder.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_hold_all_words_and_fit() {
        let font = Font::new().unwrap();
        let text = "a few words of which one is unreasonablylongandunbreakable and α ends";
        let lines = font.wrap(text, 12.0, 90.0);
        assert_eq!(lines.join(" "), text);
        assert!(lines.iter().all(|line| font.width(line, 12.0) <= 90.0 || !line.contains(' ')));
        assert!(lines.len() > 3, "{lines:?}");
    }
}
