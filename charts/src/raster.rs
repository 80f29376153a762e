//! Shapes as pixels.

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use tiny_skia::{
    Color, FillRule, FilterQuality, IntSize, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap,
    PixmapPaint, Stroke, StrokeDash, Transform,
};
use ttf_parser::OutlineBuilder;

use crate::ChartError;
use crate::canvas::{Anchor, Canvas, Colour, Shape, Spot, Turn, WHITE};
use crate::label::Area;
use crate::pictures::Picture;

/// Pixels of the PNG for one of the chart, along each side.
const ZOOM: f32 = 2.0;

/// An RGB PNG.
pub fn png(canvas: &Canvas) -> Result<Vec<u8>, ChartError> {
    let (width, height) = ((canvas.width * ZOOM) as u32, (canvas.height * ZOOM) as u32);
    let mut pixels = Pixmap::new(width, height).ok_or(ChartError::Size { width, height })?;
    pixels.fill(Color::WHITE);
    canvas.shapes.iter().for_each(|shape| draw(&mut pixels, canvas, shape));
    // All is opaque, so that premultiplied is plain.
    let rgb: Vec<u8> = pixels.data().chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes).write_image(&rgb, width, height, ExtendedColorType::Rgb8)?;
    Ok(bytes)
}

fn draw(pixels: &mut Pixmap, canvas: &Canvas, shape: &Shape) {
    match shape {
        Shape::Line { spots, colour, width, dash } => {
            stroke(pixels, path(spots, false), *colour, *width, *dash);
        }
        Shape::Area { spots, colour, .. } => {
            fill(pixels, path(spots, true), *colour, Transform::identity());
            stroke(pixels, path(spots, true), WHITE, 1.0, 0.0);
        }
        Shape::Picture { area, picture } => paste(pixels, *area, picture),
        Shape::Text { spot, text, size, colour, anchor, turn, width } => {
            let back = match anchor {
                Anchor::Start => 0.0,
                Anchor::Middle => width / 2.0,
                Anchor::End => *width,
            };
            let turned = match turn {
                Turn::Level => Transform::identity(),
                Turn::Upwards => Transform::from_rotate(-90.0),
            };
            let place = turned.pre_translate(-back, 0.0).post_translate(spot.0, spot.1);
            let mut pen = Pen { builder: PathBuilder::new(), x: 0.0, scale: 1.0 };
            canvas.font.outline(text, *size, &mut pen, |pen, x, scale| (pen.x, pen.scale) = (x, scale));
            fill(pixels, pen.builder.finish(), *colour, place);
        }
    }
}

/// Scales the picture into its area.
fn paste(pixels: &mut Pixmap, (left, top, right, bottom): Area, picture: &Picture) {
    let rgba = picture.rgb.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
    let size = IntSize::from_wh(picture.width, picture.height);
    let Some(source) = size.and_then(|size| Pixmap::from_vec(rgba, size)) else { return };
    let scale = ((right - left) / picture.width as f32, (bottom - top) / picture.height as f32);
    let place = Transform::from_scale(scale.0, scale.1).post_translate(left, top);
    let paint = PixmapPaint { quality: FilterQuality::Bilinear, ..PixmapPaint::default() };
    pixels.draw_pixmap(0, 0, source.as_ref(), &paint, zoomed(place), None);
}

fn path(spots: &[Spot], closed: bool) -> Option<Path> {
    let mut builder = PathBuilder::new();
    for (index, &(x, y)) in spots.iter().enumerate() {
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
        pixels.fill_path(&path, &paint(colour), FillRule::Winding, zoomed(transform), None);
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

/// Glyphs in font units, y upwards, to a path in px, y downwards.
struct Pen {
    builder: PathBuilder,
    x: f32,
    scale: f32,
}

impl Pen {
    fn at(&self, x: f32, y: f32) -> Spot {
        (self.x + x * self.scale, -y * self.scale)
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.builder.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.builder.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.at(x1, y1), self.at(x, y));
        self.builder.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.at(x1, y1), self.at(x2, y2), self.at(x, y));
        self.builder.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.builder.close();
    }
}
