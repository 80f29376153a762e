//! Colours and markers of the series.

use std::f32::consts::{PI, TAU};

use crate::canvas::{Canvas, Shape};
use crate::primitives::{COLOURS, Colour, FADED, Position, RADIUS};
use crate::series::Emphasis;

/// Colour, marker and dashes of the series of an index: 56 differ in colour or marker; the second seven are dashed.
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
