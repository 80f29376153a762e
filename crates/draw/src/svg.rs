//! Renders shapes as SVG 1.1.

use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;

use crate::ChartError;
use crate::canvas::{Anchor, Canvas, Shape};
use crate::picture::{LEAST_TEXT, Picture, rgb};
use crate::primitives::{Area, Colour, Position, WHITE};

/// Pixels of an image for one px of the chart, along each side.
const ZOOM: f32 = 1.5;
/// Quality of JPEG, of 100.
const QUALITY: u8 = 82;

/// Renders the canvas as an SVG document.
pub fn text(canvas: &Canvas) -> Result<String, ChartError> {
    let (width, height) = (canvas.width, canvas.height);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"DejaVu Sans, Verdana, sans-serif\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"{}\"/>\n",
        hex(WHITE)
    );
    canvas.shapes.iter().try_for_each(|shape| push(&mut out, shape))?;
    out.push_str("</svg>\n");
    Ok(out)
}

/// Embeds the image with its boxes as JPEG.
fn image(out: &mut String, (left, top, right, bottom): Area, picture: &Picture) -> Result<(), ChartError> {
    let (width, height) = (right - left, bottom - top);
    // A report embeds many photographs, which are much smaller as JPEG than as PNG.
    let drawn = picture.annotated_at((ZOOM * width) as u32, (ZOOM * height) as u32, ZOOM * LEAST_TEXT)?;
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, QUALITY).encode_image(&rgb(&drawn))?;
    let data = STANDARD.encode(jpeg);
    // Writing to a String cannot fail.
    let _ = writeln!(
        out,
        "<image x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" \
         preserveAspectRatio=\"none\" href=\"data:image/jpeg;base64,{data}\"/>"
    );
    Ok(())
}

fn push(out: &mut String, shape: &Shape) -> Result<(), ChartError> {
    // Writing to a String cannot fail.
    let _ = match shape {
        Shape::Line { points, colour, width, dash } => writeln!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{width}\"{}/>",
            coordinates(points),
            hex(*colour),
            if *dash > 0.0 { format!(" stroke-dasharray=\"{dash}\"") } else { String::new() }
        ),
        Shape::Area { points, fill, edge: (edge, width), hover } => writeln!(
            out,
            "<polygon points=\"{}\" fill=\"{}\" stroke=\"{}\" stroke-width=\"{width}\">{}</polygon>",
            coordinates(points),
            fill.map_or_else(|| "none\" pointer-events=\"all".to_owned(), hex),
            hex(*edge),
            if hover.is_empty() { String::new() } else { format!("<title>{}</title>", escaped(hover)) }
        ),
        Shape::Picture { area, picture } => return image(out, *area, picture),
        Shape::Text { position: (x, y), text, size, colour, anchor, is_upwards, width } => {
            let anchor = match anchor {
                Anchor::Start => "start",
                Anchor::Middle => "middle",
                Anchor::End => "end",
            };
            let rotation = is_upwards.then(|| format!(" transform=\"rotate(-90 {x:.1} {y:.1})\""));
            // `textLength` makes the browser stretch the text to the width that the layout assumed. Without it, another
            // font than DejaVu Sans would make labels cover each other.
            writeln!(
                out,
                "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" fill=\"{}\" text-anchor=\"{anchor}\" \
                 textLength=\"{width:.1}\" lengthAdjust=\"spacingAndGlyphs\"{}>{}</text>",
                hex(*colour),
                rotation.unwrap_or_default(),
                escaped(text)
            )
        }
    };
    Ok(())
}

fn coordinates(points: &[Position]) -> String {
    points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
}

fn hex([r, g, b]: Colour) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn escaped(text: &str) -> String {
    // The ampersand comes first: later it would also replace those of the other entities.
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
