//! [`sheet`]: several images as one, with names and a legend.

use image::{GenericImage, Rgb, RgbImage};
use imageproc::drawing::draw_filled_rect_mut;
use imageproc::rect::Rect;

use crate::font::Font;
use crate::picture::{Lettering, Picture};
use crate::primitives::INK;
use crate::primitives::class_colour;

/// Width of the white gap between images, px.
const GAP: u32 = 6;
/// Font size of names and legend, px.
const SIZE: f32 = 15.0;
/// Height of a line of text, px.
const LINE: u32 = 24;

/// Draws images of one size in two columns, row by row, each below its name. A legend below them names the colours of
/// `classes`; entries that have no room are left out. `None` without images, or if their sizes differ.
pub fn sheet(pictures: &[(&str, Picture)], classes: &[&str]) -> Option<RgbImage> {
    let (width, height) = pictures.first()?.1.size();
    if pictures.iter().any(|(_, picture)| picture.size() != (width, height)) {
        return None;
    }
    let (columns, rows) = (pictures.len().min(2) as u32, pictures.len().div_ceil(2) as u32);
    let total = (columns * (width + GAP) - GAP, rows * (LINE + height) + LINE);
    let mut sheet = RgbImage::from_pixel(total.0, total.1, Rgb([u8::MAX; 3]));
    let text = Lettering { font: Font::new(), size: SIZE };
    for (index, (name, picture)) in (0u32..).zip(pictures) {
        let (left, top) = (index % 2 * (width + GAP), index / 2 * (LINE + height));
        text.draw(&mut sheet, (left as f32 + 2.0, top as f32, (top + LINE) as f32), name, INK);
        sheet.copy_from(&picture.annotated(), left, top + LINE).expect("the sheet has room for all images");
    }
    legend(&mut sheet, &text, classes);
    Some(sheet)
}

/// Draws the legend into the last line.
fn legend(sheet: &mut RgbImage, text: &Lettering, classes: &[&str]) {
    let (top, bottom) = ((sheet.height() - LINE) as f32, sheet.height() as f32);
    let mut left = 2.0;
    for class in classes {
        let block = Rect::at(left as i32, top as i32 + 6).of_size(LINE - 11, LINE - 11);
        let (start, width) = (left + LINE as f32 - 5.0, text.font.width(class, SIZE));
        if start + width > sheet.width() as f32 {
            return;
        }
        draw_filled_rect_mut(sheet, block, Rgb(class_colour(class)));
        text.draw(sheet, (start, top, bottom), class, INK);
        left = (start + width + 1.2 * SIZE).ceil();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(value: u8, width: u32) -> Picture {
        Picture::new(width, 2, vec![value; 6 * width as usize], vec![]).expect("a picture")
    }

    #[test]
    fn four_images_are_two_rows_with_a_gap_between() {
        let pictures = [1, 2, 3, 4].map(|value| ("one", plain(value, 90)));
        let sheet = sheet(&pictures, &["car", "a class whose name is longer than the sheet is wide"])
            .expect("a sheet");
        assert_eq!(sheet.dimensions(), (90 + GAP + 90, 3 * LINE + 4));
        let at = |x, y| sheet.get_pixel(x, y).0[0];
        let corners = [at(0, LINE), at(90 + GAP, LINE), at(0, 2 * LINE + 2), at(90 + GAP, 2 * LINE + 2)];
        assert_eq!((corners, at(90, LINE)), ([1, 2, 3, 4], 255));
        assert!(sheet.pixels().any(|pixel| pixel.0 == class_colour("car")), "the legend shows the car");
    }

    #[test]
    fn sizes_that_differ_give_none() {
        assert_eq!(sheet(&[("one", plain(1, 3)), ("two", plain(1, 4))], &[]), None);
        assert_eq!(sheet(&[], &[]), None);
    }
}
