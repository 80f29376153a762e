//! [`Font`]: the widths and the outlines of texts.

use ab_glyph::{Font as _, FontRef, GlyphId, OutlineCurve};
use tiny_skia::{Path, PathBuilder};

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
