//! Renders shapes as pixels.

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use tiny_skia::{
    Color, FillRule, FilterQuality, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, PixmapPaint, Rect,
    Stroke, StrokeDash, Transform,
};

use crate::ChartError;
use crate::canvas::{Anchor, Canvas, Rotation, Shape};
use crate::font::Font;
use crate::picture::Picture;
use crate::primitives::{Area, Colour, Position, WHITE, bright};

/// Pixels of the PNG for one px of the chart, along each side.
const ZOOM: f32 = 2.0;
/// Line width of a box on an image, px.
const LINE: f32 = 2.0;
/// Images with at least this many columns have large labels.
const WIDE: u32 = 640;
const SMALL: f32 = 10.0;
const LARGE: f32 = 15.0;

/// Renders the canvas as RGB PNG.
pub fn png(canvas: &Canvas) -> Result<Vec<u8>, ChartError> {
    let (width, height) = ((canvas.width * ZOOM) as u32, (canvas.height * ZOOM) as u32);
    let mut pixels = Pixmap::new(width, height).ok_or(ChartError::Size(width, height))?;
    pixels.fill(Color::WHITE);
    canvas.shapes.iter().try_for_each(|shape| draw(&mut pixels, canvas, shape))?;
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes).write_image(&rgb(&pixels), width, height, ExtendedColorType::Rgb8)?;
    Ok(bytes)
}

impl Picture {
    /// Draws the boxes into the image, the first ones first. The label of a box is above it if there is room, else inside.
    /// Returns red, green and blue of each pixel, row by row.
    ///
    /// # Errors
    /// [`ChartError::Font`] or [`ChartError::Size`].
    pub fn annotated(&self, labels: &[String]) -> Result<Vec<u8>, ChartError> {
        annotated(self, labels)
    }
}

fn annotated(picture: &Picture, labels: &[String]) -> Result<Vec<u8>, ChartError> {
    let font = Font::new()?;
    let size = if picture.width < WIDE { SMALL } else { LARGE };
    let height = (1.3 * size).ceil();
    let mut pixels = pixmap(picture)?;
    for ((corners, index), label) in picture.boxes.iter().zip(labels) {
        if corners.iter().any(|at| !at.is_finite()) {
            continue;
        }
        // Rounded to whole pixels, so that lines are sharp.
        let [left, top, right, bottom] = corners.map(|at| at.round().clamp(-1e6, 1e6));
        let colour = bright(*index);
        let above = if top >= height { top - height } else { top };
        let lines = [
            (left, top, right, top + LINE),
            (left, bottom - LINE, right, bottom),
            (left, top, left + LINE, bottom),
            (right - LINE, top, right, bottom),
            (left, above, left + (font.width(label, size) + 2.0 * LINE).ceil(), above + height),
        ];
        for (left, top, right, bottom) in lines {
            if let Some(area) = Rect::from_ltrb(left, top, right, bottom) {
                pixels.fill_rect(area, &paint(colour), Transform::identity(), None);
            }
        }
        let place = Transform::from_translate(left + LINE, above + size);
        fill(&mut pixels, font.path(label, size), ink_on(colour), place);
    }
    Ok(rgb(&pixels))
}

/// Black or white, whichever has the higher contrast (luma of ITU-R BT.601).
fn ink_on([red, green, blue]: Colour) -> Colour {
    let luma = 299 * u32::from(red) + 587 * u32::from(green) + 114 * u32::from(blue);
    if luma >= 128_000 { [0; 3] } else { WHITE }
}

/// Red, green and blue of each pixel. All pixels are opaque, so that premultiplied samples equal the plain ones.
fn rgb(pixels: &Pixmap) -> Vec<u8> {
    let mut rgb = Vec::with_capacity(pixels.data().len() / 4 * 3);
    pixels.data().chunks_exact(4).for_each(|pixel| rgb.extend_from_slice(&pixel[..3]));
    rgb
}

fn pixmap(picture: &Picture) -> Result<Pixmap, ChartError> {
    let Picture { width, height, .. } = *picture;
    let mut pixels = Pixmap::new(width, height).ok_or(ChartError::Size(width, height))?;
    pixels.fill(Color::WHITE);
    for (pixel, rgb) in pixels.data_mut().chunks_exact_mut(4).zip(picture.rgb.chunks_exact(3)) {
        pixel[..3].copy_from_slice(rgb);
    }
    Ok(pixels)
}

fn draw(pixels: &mut Pixmap, canvas: &Canvas, shape: &Shape) -> Result<(), ChartError> {
    match shape {
        Shape::Line { points, colour, width, dash } => {
            stroke(pixels, path(points, false), *colour, *width, *dash);
        }
        Shape::Area { points, colour, .. } => {
            fill(pixels, path(points, true), *colour, zoomed(Transform::identity()));
            stroke(pixels, path(points, true), WHITE, 1.0, 0.0);
        }
        Shape::Picture { area, picture } => paste(pixels, *area, picture)?,
        Shape::Text { position, text, size, colour, anchor, rotation, width } => {
            let back = match anchor {
                Anchor::Start => 0.0,
                Anchor::Middle => width / 2.0,
                Anchor::End => *width,
            };
            let turned = match rotation {
                Rotation::Horizontal => Transform::identity(),
                Rotation::Upwards => Transform::from_rotate(-90.0),
            };
            let place = turned.pre_translate(-back, 0.0).post_translate(position.0, position.1);
            fill(pixels, canvas.font.path(text, *size), *colour, zoomed(place));
        }
    }
    Ok(())
}

/// Scales the image into its area.
fn paste(pixels: &mut Pixmap, (left, top, right, bottom): Area, picture: &Picture) -> Result<(), ChartError> {
    let source = pixmap(picture)?;
    let scale = ((right - left) / picture.width as f32, (bottom - top) / picture.height as f32);
    let place = Transform::from_scale(scale.0, scale.1).post_translate(left, top);
    let paint = PixmapPaint { quality: FilterQuality::Bilinear, ..PixmapPaint::default() };
    pixels.draw_pixmap(0, 0, source.as_ref(), &paint, zoomed(place), None);
    Ok(())
}

fn path(points: &[Position], closed: bool) -> Option<Path> {
    let mut builder = PathBuilder::new();
    for (index, &(x, y)) in points.iter().enumerate() {
        if index == 0 { builder.move_to(x, y) } else { builder.line_to(x, y) }
    }
    if closed {
        builder.close();
    }
    builder.finish()
}

fn paint(colour: Colour) -> Paint<'static> {
    let [r, g, b] = colour;
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color_rgba8(r, g, b, 255);
    paint
}

fn zoomed(transform: Transform) -> Transform {
    transform.post_scale(ZOOM, ZOOM)
}

fn fill(pixels: &mut Pixmap, path: Option<Path>, colour: Colour, transform: Transform) {
    if let Some(path) = path {
        pixels.fill_path(&path, &paint(colour), FillRule::Winding, transform, None);
    }
}

fn stroke(pixels: &mut Pixmap, path: Option<Path>, colour: Colour, width: f32, dash: f32) {
    let dash = if dash > 0.0 { StrokeDash::new(vec![dash, dash], 0.0) } else { None };
    let stroke =
        Stroke { width, dash, line_cap: LineCap::Butt, line_join: LineJoin::Round, ..Stroke::default() };
    if let Some(path) = path {
        pixels.stroke_path(&path, &paint(colour), &stroke, zoomed(Transform::identity()), None);
    }
}
