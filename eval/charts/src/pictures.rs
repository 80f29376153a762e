//! [`Pictures`]: images with boxes in rows and columns.

use crate::canvas::{Anchor, Canvas, Shape};
use crate::picture::Picture;
use crate::primitives::{GREY, INK, Position, bright};

/// A table of images.
#[derive(Clone, Debug, PartialEq)]
pub struct Pictures {
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Name of each row and its image in each column. `None` leaves the place empty.
    pub rows: Vec<(String, Vec<Option<Picture>>)>,
}

const SIZE: f32 = 12.5;
const GAP: f32 = 6.0;
/// Line width of a box, px.
const LINE: f32 = 1.6;

impl Pictures {
    /// Draws into (left, top, width). Returns the y below it.
    pub(crate) fn draw(&self, canvas: &mut Canvas, (left, top, width): (f32, f32, f32)) -> f32 {
        let columns = self.columns.len().max(1) as f32;
        let cell = (width - left + GAP) / columns - GAP;
        let at = |column: usize| left + column as f32 * (cell + GAP);
        for (column, name) in self.columns.iter().enumerate() {
            canvas.text((at(column) + cell / 2.0, top + SIZE), name, SIZE, INK, Anchor::Middle);
        }
        let mut y = top + 2.0 * SIZE;
        for (name, pictures) in &self.rows {
            canvas.text((left, y + SIZE), name, SIZE, GREY, Anchor::Start);
            y += 1.6 * SIZE;
            let scale = |picture: &Picture| cell / picture.width as f32;
            for (column, picture) in pictures.iter().enumerate() {
                if let Some(picture) = picture {
                    draw(canvas, picture, (at(column), y), scale(picture));
                }
            }
            let heights = pictures.iter().flatten().map(|picture| scale(picture) * picture.height as f32);
            y += heights.fold(SIZE, f32::max) + GAP;
        }
        y
    }
}

fn draw(canvas: &mut Canvas, picture: &Picture, (x, y): Position, scale: f32) {
    let (width, height) = (scale * picture.width as f32, scale * picture.height as f32);
    canvas.shapes.push(Shape::Picture { area: (x, y, x + width, y + height), picture: picture.clone() });
    for ([x1, y1, x2, y2], colour) in &picture.boxes {
        let at = |dx: f32, dy: f32| (x + (scale * dx).clamp(0.0, width), y + (scale * dy).clamp(0.0, height));
        let corners = vec![at(*x1, *y1), at(*x2, *y1), at(*x2, *y2), at(*x1, *y2), at(*x1, *y1)];
        canvas.line(corners, bright(*colour), LINE);
    }
}
