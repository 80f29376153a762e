//! Shapes as SVG 1.1.

use std::fmt::Write;

use crate::canvas::{Anchor, Canvas, Colour, Shape, Spot, Turn, WHITE};

/// The whole document.
pub fn text(canvas: &Canvas) -> String {
    let (width, height) = (canvas.width, canvas.height);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"DejaVu Sans, Verdana, sans-serif\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"{}\"/>\n",
        hex(WHITE)
    );
    canvas.shapes.iter().for_each(|shape| push(&mut out, shape));
    out.push_str("</svg>\n");
    out
}

fn push(out: &mut String, shape: &Shape) {
    // Writing to a String cannot fail.
    let _ = match shape {
        Shape::Line { spots, colour, width, dash } => {
            let dashes = if *dash > 0.0 { format!(" stroke-dasharray=\"{dash}\"") } else { String::new() };
            writeln!(
                out,
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{width}\"{dashes}/>",
                points(spots),
                hex(*colour)
            )
        }
        Shape::Area { spots, colour, hover } => writeln!(
            out,
            "<polygon points=\"{}\" fill=\"{}\" stroke=\"{}\" stroke-width=\"1\">{}</polygon>",
            points(spots),
            hex(*colour),
            hex(WHITE),
            if hover.is_empty() { String::new() } else { format!("<title>{}</title>", escaped(hover)) }
        ),
        Shape::Text { spot: (x, y), text, size, colour, anchor, turn, width } => {
            let anchor = match anchor {
                Anchor::Start => "start",
                Anchor::Middle => "middle",
                Anchor::End => "end",
            };
            let turn = match turn {
                Turn::Level => String::new(),
                Turn::Upwards => format!(" transform=\"rotate(-90 {x:.1} {y:.1})\""),
            };
            // The length holds the text in its place where another font stands in.
            writeln!(
                out,
                "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" fill=\"{}\" text-anchor=\"{anchor}\" \
                 textLength=\"{width:.1}\" lengthAdjust=\"spacingAndGlyphs\"{turn}>{}</text>",
                hex(*colour),
                escaped(text)
            )
        }
    };
}

fn points(spots: &[Spot]) -> String {
    spots.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
}

fn hex([r, g, b]: Colour) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
