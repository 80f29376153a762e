//! [`Font`]: DejaVu Sans from the program itself; no file, no system font.

use ttf_parser::{Face, FaceParsingError, OutlineBuilder};

/// The one typeface of all charts.
pub struct Font(Face<'static>);

impl Font {
    pub fn new() -> Result<Self, FaceParsingError> {
        Ok(Self(Face::parse(dejavu::sans::regular(), 0)?))
    }

    /// Length of `text` in px at `size` px.
    pub fn width(&self, text: &str, size: f32) -> f32 {
        text.chars().map(|c| self.advance(c, size)).sum()
    }

    /// Draws the outlines of `text` from left to right; `move_to` is told the x of each glyph in px
    /// and the px of a font unit.
    pub fn outline<B: OutlineBuilder>(
        &self,
        text: &str,
        size: f32,
        builder: &mut B,
        mut move_to: impl FnMut(&mut B, f32, f32),
    ) {
        let mut x = 0.0;
        for c in text.chars() {
            if let Some(glyph) = self.0.glyph_index(c) {
                move_to(builder, x, self.scale(size));
                self.0.outline_glyph(glyph, builder);
            }
            x += self.advance(c, size);
        }
    }

    /// `text` in lines of at most `width` px, broken at spaces; a longer word has a line of its own.
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
        let glyph = self.0.glyph_index(c).unwrap_or_default();
        f32::from(self.0.glyph_hor_advance(glyph).unwrap_or_default()) * self.scale(size)
    }

    fn scale(&self, size: f32) -> f32 {
        size / f32::from(self.0.units_per_em().max(1))
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
