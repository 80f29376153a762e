//! [`Picture`]: an image with labelled boxes, and [`sheet`]: several as one image.

use std::sync::Arc;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::{FilterType, resize};
use tiny_skia::{Color, FillRule, Paint, PathBuilder, Pixmap, PixmapPaint, Rect, Stroke, Transform};

use crate::ChartError;
use crate::font::Font;
use crate::plates::{connection, place};
use crate::primitives::{Area, Colour, INK, class_colour, ink_on};

/// An image with labelled boxes.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pixels: Arc<RgbImage>,
    boxes: Vec<LabelledBox>,
}

/// A box on an image.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelledBox {
    /// Left, top, right and bottom in px of the image.
    pub corners: [f32; 4],
    /// Red, green and blue.
    pub colour: [u8; 3],
    /// The text of its label. A box with an empty text has no label.
    pub label: String,
}

impl Picture {
    /// An image of `height` rows and `width` columns. `rgb` has red, green and blue of each pixel, row by row. The first
    /// boxes are drawn over the others and have the first choice of places for their labels.
    ///
    /// # Errors
    /// [`ChartError::Picture`] if the number of samples does not fit.
    pub fn new(width: u32, height: u32, rgb: Vec<u8>, boxes: Vec<LabelledBox>) -> Result<Self, ChartError> {
        let samples = rgb.len();
        let pixels = RgbImage::from_raw(width, height, rgb);
        let fits = pixels.filter(|image| samples > 0 && image.as_raw().len() == samples);
        let pixels = Arc::new(fits.ok_or(ChartError::Picture(width, height, samples))?);
        Ok(Self { pixels, boxes })
    }

    fn size(&self) -> (u32, u32) {
        self.pixels.dimensions()
    }

    /// Returns the image with the boxes and their labels drawn in.
    ///
    /// Labels are within the image and never cover each other. They avoid objects if there is room. A label without a free
    /// place is left out.
    ///
    /// # Errors
    /// [`ChartError::Size`] if the image is too large to be drawn on.
    pub fn annotated(&self) -> Result<RgbImage, ChartError> {
        self.drawn().map(|image| rgb(&image))
    }

    /// Returns the image without its boxes as the address of a JPEG that a page embeds, at most 1,800 px wide.
    ///
    /// # Errors
    /// [`ChartError::Encode`].
    pub fn embedded(&self) -> Result<String, ChartError> {
        let (width, height) = self.size();
        let narrow = width.min(EMBEDDED);
        let size = (narrow, (height * narrow / width).max(1));
        let image = resize(&*self.pixels, size.0, size.1, FilterType::Triangle);
        let mut jpeg = Vec::new();
        // A report with photographs is much smaller with JPEG than with PNG.
        JpegEncoder::new_with_quality(&mut jpeg, QUALITY).encode_image(&image)?;
        Ok(format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg)))
    }

    fn drawn(&self) -> Result<Pixmap, ChartError> {
        let mut image = pixmap(&self.pixels)?;
        let size = (image.width() as f32, image.height() as f32);
        let mean = (size.0 + size.1) / 2.0;
        // The rule of the ultralytics package.
        let line = (0.003 * mean).round().max(2.0);
        let text = Lettering { font: Font::new(), size: (0.02 * mean).round().max(LEAST_LABEL) };
        let visible = |labelled| Some((labelled, visible(labelled, size)?));
        let boxes: Vec<(&LabelledBox, Area)> = self.boxes.iter().filter_map(visible).collect();
        for (labelled, area) in boxes.iter().rev() {
            outline(&mut image, *area, line, labelled.colour);
        }
        let labelled: Vec<_> = boxes.into_iter().filter(|(labelled, _)| !labelled.label.is_empty()).collect();
        let sizes: Vec<_> = labelled.iter().map(|(labelled, _)| text.plate(&labelled.label)).collect();
        let areas: Vec<Area> = labelled.iter().map(|(_, area)| *area).collect();
        let places = place(&areas, &sizes, size);
        let placed =
            || labelled.iter().zip(&places).filter_map(|(labelled, place)| Some((labelled, (*place)?)));
        for ((labelled, area), plate) in placed() {
            connect(&mut image, *area, plate, labelled.colour);
        }
        for ((labelled, _), (left, top, right, bottom)) in placed() {
            block(&mut image, (left.floor(), top.floor(), right.floor(), bottom.floor()), labelled.colour);
            let place = (left + 0.3 * text.size, top, bottom);
            text.draw(&mut image, place, &labelled.label, ink_on(labelled.colour));
        }
        Ok(image)
    }
}

/// Largest width of an image in a page, px.
const EMBEDDED: u32 = 1800;
/// Quality of JPEG, of 100.
const QUALITY: u8 = 82;
/// Least font size of the labels on an image, px.
const LEAST_LABEL: f32 = 12.0;
/// Colour of the thin line around a box.
const CASING: Colour = [0x20; 3];

/// The visible part of a box, in whole pixels of an image of size `(width, height)`. `None` if it is outside.
fn visible(labelled: &LabelledBox, (width, height): (f32, f32)) -> Option<Area> {
    let [left, top, right, bottom] = labelled.corners.map(f32::round);
    let area = (left.max(0.0), top.max(0.0), right.min(width), bottom.min(height));
    let finite = labelled.corners.iter().all(|at| at.is_finite());
    (finite && area.0 < area.2 && area.1 < area.3).then_some(area)
}

/// Draws lines of `line` px inside the area, which has whole numbers, and a dark line around them, which separates them from
/// a bright image.
fn outline(image: &mut Pixmap, area: Area, line: f32, colour: Colour) {
    let (left, top, right, bottom) = area;
    frame(image, (left - 1.0, top - 1.0, right + 1.0, bottom + 1.0), 1.0, CASING);
    frame(image, area, line, colour);
}

/// Draws lines of `line` px along the sides of the area, which has whole numbers, on its inner side.
fn frame(image: &mut Pixmap, (left, top, right, bottom): Area, line: f32, colour: Colour) {
    // The lines of a small area meet, and fill it.
    let (width, height) = (line.min(right - left), line.min(bottom - top));
    for side in [
        (left, top, right, top + height),
        (left, bottom - height, right, bottom),
        (left, top, left + width, bottom),
        (right - width, top, right, bottom),
    ] {
        block(image, side, colour);
    }
}

/// Fills the area, which has whole numbers.
fn block(image: &mut Pixmap, (left, top, right, bottom): Area, colour: Colour) {
    if let Some(area) = Rect::from_ltrb(left, top, right, bottom) {
        image.fill_rect(area, &paint(colour), Transform::identity(), None);
    }
}

/// Draws a line from the box to its label if they do not touch.
fn connect(image: &mut Pixmap, of: Area, plate: Area, colour: Colour) {
    let Some((from, to)) = connection(of, plate) else { return };
    let mut line = PathBuilder::new();
    line.move_to(from.0, from.1);
    line.line_to(to.0, to.1);
    if let Some(line) = line.finish() {
        // As thick as a box.
        let stroke = Stroke { width: 2.0, ..Stroke::default() };
        image.stroke_path(&line, &paint(colour), &stroke, Transform::identity(), None);
    }
}

struct Lettering {
    pub font: Font,
    /// Font size, px.
    pub size: f32,
}

impl Lettering {
    /// Width and height of the plate of a text, px.
    fn plate(&self, text: &str) -> (f32, f32) {
        ((self.font.width(text, self.size) + 0.6 * self.size).ceil(), (1.3 * self.size).ceil())
    }

    /// Draws `text` with its left end at column `x` and its capital letters in the middle between `top` and `bottom`.
    fn draw(&self, image: &mut Pixmap, (x, top, bottom): (f32, f32, f32), text: &str, colour: Colour) {
        /// Height of a capital letter at font size 1.
        const CAPITAL: f32 = 0.73;
        let baseline = (top + bottom + CAPITAL * self.size) / 2.0;
        // On whole pixels the horizontal lines of letters are sharp.
        let place = Transform::from_translate(x.round(), baseline.round());
        if let Some(path) = self.font.path(text, self.size) {
            image.fill_path(&path, &paint(colour), FillRule::Winding, place, None);
        }
    }
}

/// Red, green and blue of each pixel. All pixels are opaque, so that premultiplied samples equal the plain ones.
fn rgb(pixels: &Pixmap) -> RgbImage {
    let mut rgb = Vec::with_capacity(pixels.data().len() / 4 * 3);
    pixels.data().chunks_exact(4).for_each(|pixel| rgb.extend_from_slice(&pixel[..3]));
    RgbImage::from_raw(pixels.width(), pixels.height(), rgb).expect("three samples a pixel")
}

/// The image as pixels to draw on.
fn pixmap(image: &RgbImage) -> Result<Pixmap, ChartError> {
    let (width, height) = image.dimensions();
    let mut pixels = Pixmap::new(width, height).ok_or(ChartError::Size(width, height))?;
    for (pixel, rgb) in pixels.data_mut().chunks_exact_mut(4).zip(image.as_raw().chunks_exact(3)) {
        pixel[..3].copy_from_slice(rgb);
        pixel[3] = u8::MAX;
    }
    Ok(pixels)
}

fn paint(colour: Colour) -> Paint<'static> {
    let [r, g, b] = colour;
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color_rgba8(r, g, b, 255);
    paint
}

/// Width of the white gap between images, px.
const SHEET_GAP: u32 = 6;
/// Font size of names and legend, px.
const SHEET_TEXT: f32 = 15.0;
/// Height of a line of text, px.
const SHEET_LINE: u32 = 24;

/// Draws images in two columns, each below its name, in places of the size of the largest one; three of them in one row, or below each
/// other where they are wide. The place of a missing image is empty. A legend below them names the colours of `classes`; entries that
/// have no room are left out. `None` without images, or if they are too large.
pub fn sheet<S: AsRef<str>>(pictures: &[(S, Option<Picture>)], classes: &[&str]) -> Option<RgbImage> {
    let sizes = pictures.iter().filter_map(|(_, picture)| Some(picture.as_ref()?.size()));
    let (width, height) = sizes.reduce(|a, b| (a.0.max(b.0), a.1.max(b.1)))?;
    let count = pictures.len() as u32;
    let columns = match count {
        // Wide images are readable below each other.
        ..=3 if width >= 2 * height => 1,
        3 => 3,
        _ => count.min(2),
    };
    let rows = count.div_ceil(columns);
    let below = if classes.is_empty() { 0 } else { SHEET_LINE };
    let total = (columns * (width + SHEET_GAP) - SHEET_GAP, rows * (SHEET_LINE + height) + below);
    let mut sheet = Pixmap::new(total.0, total.1)?;
    sheet.fill(Color::WHITE);
    let text = Lettering { font: Font::new(), size: SHEET_TEXT };
    for (index, (name, picture)) in (0u32..).zip(pictures) {
        let (left, top) = (index % columns * (width + SHEET_GAP), index / columns * (SHEET_LINE + height));
        text.draw(&mut sheet, (left as f32 + 2.0, top as f32, (top + SHEET_LINE) as f32), name.as_ref(), INK);
        let Some(picture) = picture else { continue };
        let picture = picture.drawn().ok()?;
        let (left, top) = (left as i32, (top + SHEET_LINE) as i32);
        let paint = PixmapPaint::default();
        sheet.draw_pixmap(left, top, picture.as_ref(), &paint, Transform::identity(), None);
    }
    legend(&mut sheet, &text, classes);
    Some(rgb(&sheet))
}

/// Draws the legend into the last line.
fn legend(sheet: &mut Pixmap, text: &Lettering, classes: &[&str]) {
    let (top, bottom) = ((sheet.height() - SHEET_LINE) as f32, sheet.height() as f32);
    let side = SHEET_LINE as f32 - 11.0;
    let mut left = 2.0;
    for class in classes {
        let (start, width) = (left + SHEET_LINE as f32 - 5.0, text.font.width(class, SHEET_TEXT));
        if start + width > sheet.width() as f32 {
            return;
        }
        block(sheet, (left, top + 6.0, left + side, top + 6.0 + side), class_colour(class));
        text.draw(sheet, (start, top, bottom), class, INK);
        left = (start + width + 1.2 * SHEET_TEXT).ceil();
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
        let pictures = [1, 2, 3, 4].map(|value| ("one", Some(plain(value, 90))));
        let sheet = sheet(&pictures, &["car", "a class whose name is longer than the sheet is wide"])
            .expect("a sheet");
        assert_eq!(sheet.dimensions(), (90 + SHEET_GAP + 90, 3 * SHEET_LINE + 4));
        let at = |x, y| sheet.get_pixel(x, y).0[0];
        let corners = [
            at(0, SHEET_LINE),
            at(90 + SHEET_GAP, SHEET_LINE),
            at(0, 2 * SHEET_LINE + 2),
            at(90 + SHEET_GAP, 2 * SHEET_LINE + 2),
        ];
        assert_eq!((corners, at(90, SHEET_LINE)), ([1, 2, 3, 4], 255));
        assert!(sheet.pixels().any(|pixel| pixel.0 == class_colour("car")), "the legend shows the car");
    }

    #[test]
    fn images_of_other_sizes_and_missing_ones_have_places_of_one_size() {
        let pictures = [("one", Some(plain(1, 2))), ("two", None), ("three", Some(plain(3, 3)))];
        let narrow = sheet(&pictures, &[]).expect("a sheet");
        assert_eq!(narrow.dimensions(), (3 * 3 + 2 * SHEET_GAP, SHEET_LINE + 2), "three are one row");
        let at = |x| narrow.get_pixel(x, SHEET_LINE).0[0];
        assert_eq!([at(0), at(2), at(3 + SHEET_GAP), at(2 * (3 + SHEET_GAP))], [1, 255, 255, 3]);
        let wide = sheet(&[1, 2, 3].map(|value| ("", Some(plain(value, 4)))), &[]).expect("a sheet");
        assert_eq!(wide.dimensions(), (4, 3 * SHEET_LINE + 6), "three wide ones are one column");
        assert_eq!(sheet::<&str>(&[], &[]), None);
    }
}
