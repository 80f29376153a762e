//! Renders shapes as pixels.

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use tiny_skia::{Color, LineCap, LineJoin, Path, Pixmap, PixmapPaint, Stroke, StrokeDash, Transform};

use crate::ChartError;
use crate::canvas::{Anchor, Canvas, Shape};
use crate::picture::{LEAST_TEXT, Picture, fill, paint, path, rgb};
use crate::primitives::{Area, Colour};

/// Pixels of the PNG for one px of the chart, along each side.
const ZOOM: f32 = 2.0;

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

fn draw(pixels: &mut Pixmap, canvas: &Canvas, shape: &Shape) -> Result<(), ChartError> {
    match shape {
        Shape::Line { points, colour, width, dash } => {
            stroke(pixels, path(points, false), *colour, *width, *dash);
        }
        Shape::Area { points, fill: colour, edge: (edge, width), .. } => {
            if let Some(colour) = colour {
                fill(pixels, path(points, true), *colour, zoomed(Transform::identity()));
            }
            stroke(pixels, path(points, true), *edge, *width, 0.0);
        }
        Shape::Picture { area, picture } => paste(pixels, *area, picture)?,
        Shape::Text { position, text, size, colour, anchor, is_upwards, width } => {
            let back = match anchor {
                Anchor::Start => 0.0,
                Anchor::Middle => width / 2.0,
                Anchor::End => *width,
            };
            let turned = Transform::from_rotate(if *is_upwards { -90.0 } else { 0.0 });
            let place = turned.pre_translate(-back, 0.0).post_translate(position.0, position.1);
            fill(pixels, canvas.font.path(text, *size), *colour, zoomed(place));
        }
    }
    Ok(())
}

/// Draws the image with its boxes at the resolution of the PNG into its area.
fn paste(pixels: &mut Pixmap, (left, top, right, bottom): Area, picture: &Picture) -> Result<(), ChartError> {
    let [left, top, right, bottom] = [left, top, right, bottom].map(|at| (ZOOM * at).round() as i32);
    let image = picture.annotated_at((right - left) as u32, (bottom - top) as u32, ZOOM * LEAST_TEXT)?;
    pixels.draw_pixmap(left, top, image.as_ref(), &PixmapPaint::default(), Transform::identity(), None);
    Ok(())
}

fn zoomed(transform: Transform) -> Transform {
    transform.post_scale(ZOOM, ZOOM)
}

fn stroke(pixels: &mut Pixmap, path: Option<Path>, colour: Colour, width: f32, dash: f32) {
    let dash = if dash > 0.0 { StrokeDash::new(vec![dash, dash], 0.0) } else { None };
    let stroke =
        Stroke { width, dash, line_cap: LineCap::Butt, line_join: LineJoin::Round, ..Stroke::default() };
    if let Some(path) = path {
        pixels.stroke_path(&path, &paint(colour), &stroke, zoomed(Transform::identity()), None);
    }
}
