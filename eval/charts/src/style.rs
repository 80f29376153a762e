//! Colours and markers of the series.

use std::f32::consts::{PI, TAU};

use crate::canvas::{Canvas, Colour, FADED, Shape, Spot};
use crate::series::Tone;

/// Okabe and Ito's palette, which the colour-blind can tell apart; its yellow is left out, for it is
/// faint on white.
const COLOURS: [Colour; 7] = [
    [0x00, 0x72, 0xb2],
    [0xd5, 0x5e, 0x00],
    [0x00, 0x9e, 0x73],
    [0xcc, 0x79, 0xa7],
    [0x00, 0x00, 0x00],
    [0xe6, 0x9f, 0x00],
    [0x56, 0xb4, 0xe9],
];

/// Half the size of a marker, px.
pub const RADIUS: f32 = 6.0;

/// How the series of an index looks: 56 differ in colour or marker, the second seven are dashed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    pub colour: Colour,
    marker: usize,
    dash: f32,
}

impl Style {
    pub fn of(index: usize) -> Self {
        let dash = if index / COLOURS.len() % 2 == 1 { 5.0 } else { 0.0 };
        Self { colour: COLOURS[index % COLOURS.len()], marker: index % 8, dash }
    }

    pub fn line(&self, canvas: &mut Canvas, spots: Vec<Spot>) {
        canvas.shapes.push(Shape::Line { spots, colour: self.colour, width: 1.8, dash: self.dash });
    }

    /// The marker at a spot; `hover` is shown while a pointer is on it.
    pub fn mark(&self, canvas: &mut Canvas, (x, y): Spot, tone: Tone, hover: &str) {
        let spots = self.outline().into_iter().map(|(dx, dy)| (x + RADIUS * dx, y + RADIUS * dy)).collect();
        let hover = hover.to_owned();
        canvas.shapes.push(Shape::Area { spots, colour: self.toned(tone), hover });
    }

    pub fn toned(&self, tone: Tone) -> Colour {
        match tone {
            Tone::Full => self.colour,
            Tone::Faded => FADED,
        }
    }

    /// Around (0, 0), within a circle of about 1.
    fn outline(&self) -> Vec<Spot> {
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

/// `corners` on a circle, the first at the top, turned by `turn`.
fn polygon(corners: u8, turn: f32, radius: f32) -> Vec<Spot> {
    (0..corners).map(|i| at(TAU * f32::from(i) / f32::from(corners) + turn, radius)).collect()
}

fn star(rays: u8, inner: f32, outer: f32) -> Vec<Spot> {
    let corner =
        |i: u8| at(PI * f32::from(i) / f32::from(rays), if i.is_multiple_of(2) { outer } else { inner });
    (0..2 * rays).map(corner).collect()
}

fn at(angle: f32, radius: f32) -> Spot {
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
