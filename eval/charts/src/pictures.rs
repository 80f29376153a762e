//! [`Pictures`]: images with boxes in rows.

use crate::canvas::{Anchor, Canvas, Shape};
use crate::picture::Picture;
use crate::primitives::{GREY, INK};

/// A table of images.
#[derive(Clone, Debug, PartialEq)]
pub struct Pictures {
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Name of each row and its image in each column. `None` leaves the place empty.
    pub rows: Vec<(String, Vec<Option<Picture>>)>,
    /// Names and colours of the boxes.
    pub legend: Vec<(String, [u8; 3])>,
}

const SIZE: f32 = 12.5;
const GAP: f32 = 6.0;
/// Pages of at least this width have two images side by side.
const WIDE: f32 = 900.0;
/// Least font size on an image, px of the chart.
pub const LEAST_TEXT: f32 = 9.0;

impl Pictures {
    /// Draws into (left, top, width), each image below the name of its column. Returns the y below it.
    pub(crate) fn draw(&self, canvas: &mut Canvas, (left, top, width): (f32, f32, f32)) -> f32 {
        let columns: u8 = if canvas.width < WIDE { 1 } else { 2 };
        let cell = (width - left + GAP) / f32::from(columns) - GAP;
        let height = |picture: &Picture| cell / picture.size().0 as f32 * picture.size().1 as f32;
        let mut y = top;
        for (name, pictures) in &self.rows {
            canvas.text((left, y + SIZE), name, SIZE, INK, Anchor::Start);
            y += 1.5 * SIZE;
            let named: Vec<_> = self.columns.iter().zip(pictures).collect();
            for line in named.chunks(columns.into()) {
                y += 1.5 * SIZE;
                for (column, (name, picture)) in (0u8..).zip(line) {
                    let Some(picture) = picture else { continue };
                    let x = left + f32::from(column) * (cell + GAP);
                    canvas.text((x, y - 0.4 * SIZE), name, SIZE, GREY, Anchor::Start);
                    let area = (x, y, x + cell, y + height(picture));
                    canvas.shapes.push(Shape::Picture { area, picture: picture.clone() });
                }
                y += line.iter().filter_map(|(_, picture)| picture.as_ref()).map(height).fold(0.0, f32::max);
            }
            y += SIZE;
        }
        y
    }
}
