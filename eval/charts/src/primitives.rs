//! Positions, areas, colours, and the styles of series.

use std::f32::consts::{PI, TAU};

use crate::canvas::{Canvas, Shape};
use crate::panel::Emphasis;

/// Red, green, blue.
pub type Colour = [u8; 3];

/// Position in px from the left and the top.
pub type Position = (f32, f32);

/// Rectangle in px: left, top, right, bottom.
pub type Area = (f32, f32, f32, f32);

pub const INK: Colour = [0x22, 0x22, 0x22];
pub const GREY: Colour = [0x55, 0x55, 0x55];
pub const FADED: Colour = [0xbd, 0xbd, 0xbd];
pub const FAINT: Colour = [0xe4, 0xe4, 0xe4];
pub const WHITE: Colour = [0xff; 3];

/// Half the size of a marker, px.
pub const RADIUS: f32 = 6.0;

/// The palette of Okabe and Ito, which colour-blind readers can distinguish, without its yellow, which is faint on white.
pub const COLOURS: [Colour; 7] = [
    [0x00, 0x72, 0xb2],
    [0xd5, 0x5e, 0x00],
    [0x00, 0x9e, 0x73],
    [0xcc, 0x79, 0xa7],
    [0x00, 0x00, 0x00],
    [0xe6, 0x9f, 0x00],
    [0x56, 0xb4, 0xe9],
];

/// The colours with the names of common classes. Each colour is visible on dark and on bright images.
const CLASS_COLOURS: [(Colour, &[&str]); 12] = [
    ([0xff, 0x9f, 0x1c], &["car"]),
    ([0xff, 0x4d, 0x8d], &["pedestrian", "person"]),
    ([0x00, 0xc8, 0x96], &["cyclist", "rider"]),
    ([0x4c, 0xb4, 0xff], &["van"]),
    ([0xb0, 0x7c, 0xff], &["truck"]),
    ([0xe8, 0x50, 0x20], &["bus"]),
    ([0xa8, 0xd8, 0x30], &["bicycle", "bike"]),
    ([0x20, 0xd8, 0xe8], &["motorcycle", "motorbike"]),
    ([0x3a, 0x6c, 0xf0], &["tram", "train"]),
    ([0xf4, 0xe4, 0x30], &["traffic light"]),
    ([0xe0, 0x90, 0xd8], &["traffic sign", "stop sign"]),
    ([0xc0, 0x90, 0x60], &["dog"]),
];

/// The colour of the boxes of class `name`. It depends on the name only, so that a class has the same colour in all images
/// of all models. Names beyond the common ones of road scenes share the colours.
pub fn class_colour(name: &str) -> Colour {
    let known = |names: &&[&str]| names.iter().any(|known| known.eq_ignore_ascii_case(name));
    let common = CLASS_COLOURS.iter().position(|(_, names)| known(names));
    // The hash FNV-1a.
    let hash =
        name.bytes().fold(0x811c_9dc5_u32, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
    CLASS_COLOURS[common.unwrap_or(hash as usize % CLASS_COLOURS.len())].0
}

/// Black or white, whichever has the higher contrast (relative luminance of WCAG 2, with a gamma of 2.2).
pub fn ink_on(colour: Colour) -> Colour {
    let [red, green, blue] = colour.map(|sample| (f32::from(sample) / 255.0).powf(2.2));
    // At this luminance, both contrasts are equal: (1 + 0.05) / (L + 0.05) = (L + 0.05) / 0.05.
    if 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.179 { [0; 3] } else { WHITE }
}

/// Colour, marker and dashes of the series of an index. The first 56 styles differ in colour or marker. Lines of indices 7
/// to 13, 21 to 27 and so on are dashed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    pub colour: Colour,
    marker: usize,
    dash: f32,
}

impl Style {
    pub fn of(index: usize) -> Self {
        // Seven colours and eight markers have no common factor, so that their pairs repeat only after 56 series.
        let dash = if index / COLOURS.len() % 2 == 1 { 5.0 } else { 0.0 };
        Self { colour: COLOURS[index % COLOURS.len()], marker: index % 8, dash }
    }

    pub fn line(&self, canvas: &mut Canvas, points: Vec<Position>) {
        canvas.shapes.push(Shape::Line { points, colour: self.colour, width: 1.8, dash: self.dash });
    }

    /// Draws the marker. The SVG shows `hover` while the pointer is on it.
    pub fn mark(&self, canvas: &mut Canvas, (x, y): Position, emphasis: Emphasis, hover: &str) {
        let points = self.outline().into_iter().map(|(dx, dy)| (x + RADIUS * dx, y + RADIUS * dy)).collect();
        let hover = hover.to_owned();
        canvas.shapes.push(Shape::Area { points, colour: self.with_emphasis(emphasis), hover });
    }

    pub fn with_emphasis(&self, emphasis: Emphasis) -> Colour {
        match emphasis {
            Emphasis::Normal => self.colour,
            Emphasis::Faded => FADED,
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
    fn the_first_fifty_six_differ() {
        let styles: Vec<Style> = (0..56).map(Style::of).collect();
        for (i, a) in styles.iter().enumerate() {
            assert!(styles[..i].iter().all(|b| (a.colour, a.marker) != (b.colour, b.marker)), "{i}");
        }
    }
}
