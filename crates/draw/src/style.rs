//! [`Style`]: the colour, the marker and the dashes of a series, by its name.

use std::f32::consts::{PI, TAU};

use crate::canvas::Canvas;
use crate::primitives::{Colour, Position, RADIUS, WHITE, hash};

/// Half the width of the caps of an interval, px.
const CAP: f32 = 3.5;
const FADED: Colour = [0xbd, 0xbd, 0xbd];
const MARKERS: usize = 8;

/// Colour and marker of each stream and method of the project, by its name: it has this style in every chart. The
/// first colours are those of Okabe and Ito, which colour-blind readers can distinguish. Each marker separates
/// the names whose colours are similar.
const STYLES: [(&str, Colour, usize); 15] = [
    ("ideal", [0x00, 0x00, 0x00], 0),
    ("saturated", [0xe6, 0x9f, 0x00], 1),
    ("metered", [0x56, 0xb4, 0xe9], 3),
    ("auto_exposed", [0x00, 0x9e, 0x73], 6),
    ("modulo", [0xd5, 0x5e, 0x00], 2),
    ("auto", [0x00, 0x72, 0xb2], 3),
    ("spud", [0x00, 0x9e, 0x73], 4),
    ("spud_as_published", [0xcc, 0x79, 0xa7], 5),
    ("lines", [0x56, 0xb4, 0xe9], 6),
    ("tree", [0x88, 0x22, 0x55], 1),
    ("gradient_tree", [0x99, 0x99, 0x33], 2),
    ("least_squares", [0x8c, 0x56, 0x4b], 4),
    ("itoh", [0x44, 0xaa, 0x99], 7),
    ("checkerboard_gains", [0xbb, 0x33, 0x33], 3),
    ("pareto", [0x77, 0x77, 0x77], 0),
];

/// Colour, marker and dashes of a series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    pub colour: Colour,
    marker: usize,
    dash: f32,
    /// Whether the markers are outlines. They show a variant of a method with a dashed line, and an unknown name with a solid one.
    open: bool,
}

impl Style {
    /// The style of a series or part. It depends on the name only, so that it is the same in every chart. The first known
    /// word decides; further words, as in `recovered (auto, deblurred)`, are a variant of it. Names without a known word
    /// share the colours and have open markers, so that none looks like a known one.
    pub fn of(name: &str) -> Self {
        let mut words: Vec<&str> =
            name.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty()).collect();
        let style = |word: &&str| STYLES.iter().find(|(known, ..)| known.eq_ignore_ascii_case(word));
        let Some((_, colour, marker)) = words.iter().find_map(style) else {
            let hash = hash(name);
            let (_, colour, _) = STYLES[hash % STYLES.len()];
            return Self { colour, marker: hash / STYLES.len() % MARKERS, dash: 0.0, open: true };
        };
        words.retain(|word| style(word).is_none() && *word != "recovered");
        // Variants, such as those of several models, differ in marker and dashes. The upper bits of the hash differ for similar words, too.
        let number = if words.is_empty() { 0 } else { hash(&words.join(" ")) >> 20 };
        let dash = if words.is_empty() { 0.0 } else { [5.0, 2.0, 9.0][number % 3] };
        Self { colour: *colour, marker: (marker + number) % MARKERS, dash, open: !words.is_empty() }
    }

    pub fn line(&self, canvas: &mut Canvas, points: &[Position]) {
        canvas.line(points, self.colour, 1.8, self.dash);
    }

    /// Draws the marker. The SVG shows `hover` while the pointer is on it.
    pub fn mark(&self, canvas: &mut Canvas, (x, y): Position, is_faded: bool, hover: &str) {
        let points: Vec<Position> =
            self.outline().into_iter().map(|(dx, dy)| (x + RADIUS * dx, y + RADIUS * dy)).collect();
        let colour = if is_faded { FADED } else { self.colour };
        // An outline shows the marker that it may cover.
        let (fill, edge) = if self.open { (None, (colour, 1.8)) } else { (Some(colour), (WHITE, 1.0)) };
        canvas.area(&points, fill, edge, hover);
    }

    /// Draws the interval from `low` to `high` of a point as a vertical bar with caps.
    pub fn interval(&self, canvas: &mut Canvas, x: f32, (low, high): (f32, f32), is_faded: bool) {
        let colour = if is_faded { FADED } else { self.colour };
        canvas.line(&[(x, low), (x, high)], colour, 1.1, 0.0);
        for y in [low, high] {
            canvas.line(&[(x - CAP, y), (x + CAP, y)], colour, 1.1, 0.0);
        }
    }

    /// The outline of the marker around (0, 0), about as large as the unit circle.
    fn outline(&self) -> Vec<Position> {
        match self.marker {
            0 => polygon(24, 0.0, 0.9),
            1 => polygon(4, PI / 4.0, 1.15),
            2 => polygon(3, 0.0, 1.2),
            3 => polygon(4, 0.0, 1.2),
            4 => polygon(3, PI, 1.2),
            5 => star(5, 0.45, 1.3),
            6 => star(4, 0.36, 1.35),
            _ => polygon(6, 0.0, 1.05),
        }
    }
}

/// A polygon with its corners on a circle, the first at the top, rotated by `rotation`.
fn polygon(corners: u8, rotation: f32, radius: f32) -> Vec<Position> {
    (0..corners).map(|i| at(TAU * f32::from(i) / f32::from(corners) + rotation, radius)).collect()
}

fn star(rays: u8, inner: f32, outer: f32) -> Vec<Position> {
    let corner =
        |i: u8| at(PI * f32::from(i) / f32::from(rays), if i.is_multiple_of(2) { outer } else { inner });
    (0..2 * rays).map(corner).collect()
}

fn at(angle: f32, radius: f32) -> Position {
    (radius * angle.sin(), -radius * angle.cos())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_names_and_their_variants_differ() {
        let names = STYLES.iter().map(|(name, ..)| (*name).to_owned());
        let variants = ["recovered (auto, deblurred)", "auto, 1 thread", "auto, 2 threads", "ideal, sharp"];
        let all: Vec<Style> = names.chain(variants.map(str::to_owned)).map(|name| Style::of(&name)).collect();
        for (i, a) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|b| a != b), "{i}: {a:?}");
        }
        for unknown in (0..200).map(|number| format!("peer {number}")) {
            assert!(!all.contains(&Style::of(&unknown)), "{unknown}");
        }
        assert_eq!(Style::of("recovered (auto)"), Style::of("auto"), "the method decides");
        assert_eq!(Style::of("recovered (auto, deblurred)").colour, Style::of("auto").colour);
    }
}
