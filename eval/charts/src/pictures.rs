//! [`Pictures`]: pictures in rows and columns, with boxes on them.

use std::sync::Arc;

use crate::canvas::{Anchor, Canvas, Colour, GREY, INK, Shape, Spot};
use crate::style::Style;
use crate::{ChartError, raster};

/// Pictures under the names of their columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Pictures {
    /// From left to right.
    pub columns: Vec<String>,
    /// From top to bottom: the name, and a picture a column; `None` leaves its place empty.
    pub rows: Vec<(String, Vec<Option<Picture>>)>,
}

/// A picture with boxes.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) rgb: Arc<[u8]>,
    pub(crate) boxes: Vec<([f32; 4], usize)>,
}

const SIZE: f32 = 12.5;
const GAP: f32 = 6.0;
/// Width of the lines of a box, px.
const LINE: f32 = 1.6;

impl Picture {
    /// A picture of `height` rows and `width` columns. `rgb` has the red, green and blue of each pixel, row by row;
    /// a box has its left, top, right and bottom in px of the picture, and the index of its colour.
    ///
    /// # Errors
    /// [`ChartError::Picture`].
    pub fn new(
        width: u32,
        height: u32,
        rgb: Vec<u8>,
        boxes: Vec<([f32; 4], usize)>,
    ) -> Result<Self, ChartError> {
        let needed = 3 * u64::from(width) * u64::from(height);
        if needed == 0 || rgb.len() as u64 != needed {
            return Err(ChartError::Picture(width, height, rgb.len()));
        }
        Ok(Self { width, height, rgb: rgb.into(), boxes })
    }

    /// The samples of the picture with its boxes drawn in, the first ones first, each with its label.
    ///
    /// # Errors
    /// [`ChartError::Font`]; [`ChartError::Size`].
    pub fn annotated(&self, labels: &[String]) -> Result<Vec<u8>, ChartError> {
        raster::annotated(self, labels)
    }
}

impl Pictures {
    /// Draws into (left, top, width); returns the y after it.
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

fn draw(canvas: &mut Canvas, picture: &Picture, (x, y): Spot, scale: f32) {
    let (width, height) = (scale * picture.width as f32, scale * picture.height as f32);
    canvas.shapes.push(Shape::Picture { area: (x, y, x + width, y + height), picture: picture.clone() });
    for ([x1, y1, x2, y2], colour) in &picture.boxes {
        let at = |dx: f32, dy: f32| (x + (scale * dx).clamp(0.0, width), y + (scale * dy).clamp(0.0, height));
        let corners = vec![at(*x1, *y1), at(*x2, *y1), at(*x2, *y2), at(*x1, *y2), at(*x1, *y1)];
        canvas.line(corners, bright(*colour), LINE);
    }
}

/// A colour that is seen on dark pictures too.
pub fn bright(index: usize) -> Colour {
    const BLACK: Colour = [0; 3];
    match Style::of(index).colour {
        BLACK => [0xf0, 0xe4, 0x42],
        colour => colour,
    }
}
