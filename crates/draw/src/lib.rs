//! Charts as SVG, labelled boxes on images, and the frame of an HTML page. The font is embedded in the program.
//!
//! A [`Chart`] is data, and [`Chart::svg`] draws it. The name of a series determines its colour and
//! marker in every chart, and markers distinguish the series without colour. No file is read or
//! written.

mod axis;
mod canvas;
mod chart;
mod font;
mod panel;
mod picture;
mod plates;
mod primitives;
mod style;

pub use image::RgbImage;

pub use axis::{Axis, Scale, ascending, distinct};
pub use chart::{Chart, PageWidth};
pub use panel::{ChartPanel, DataPoint, Series, SeriesStyle};
pub use picture::{LabelledBox, Picture, sheet};
pub use primitives::class_colour;

use maud::{DOCTYPE, Markup, PreEscaped, html};

/// Error of a picture.
#[derive(Debug, thiserror::Error)]
pub enum ChartError {
    /// A picture with this number of columns and rows is empty or too large.
    #[error("a picture of {0} x {1} px cannot be painted")]
    Size(u32, u32),
    /// The number of samples does not fit the number of columns and rows.
    #[error("a picture of {0} x {1} px has {2} samples, three a pixel are needed")]
    Picture(u32, u32, usize),
    /// The picture cannot be encoded.
    #[error("picture: {0}")]
    Encode(#[from] image::ImageError),
}

/// `value` with `digits` decimal digits. A value that is rounded to zero has no sign: `-0.0` is never written.
pub fn number(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let unsigned = text.strip_prefix('-').filter(|rest| rest.chars().all(|c| c == '0' || c == '.'));
    unsigned.map_or_else(|| text.clone(), str::to_owned)
}

/// A fraction as percent with `digits` decimal digits, or with as many more as keep a fraction below 1 from being rounded to
/// 100.
pub fn below_100(fraction: f64, digits: usize) -> String {
    let text = number(100.0 * fraction, digits);
    let rounded_up = fraction < 1.0 && text.starts_with("100") && digits < MOST_DIGITS;
    if rounded_up { below_100(fraction, digits + 1) } else { text }
}

/// Decimal digits beyond which a percentage in double precision says nothing.
const MOST_DIGITS: usize = 13;

/// An HTML page with the style sheet that all pages share, followed by the rules `css` of this page.
pub fn html_page(title: &str, css: &str, body: Markup) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(include_str!("page.css"))) (PreEscaped(css)) }
            }
            body { main { (body) } }
        }
    }
    .into_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_whole_is_never_100_percent() {
        assert_eq!(below_100(1.0 - 3.0 / 1_397_250.0, 3), "99.9998");
        assert_eq!(below_100(1.0 - 7.0 / 1_397_250.0, 3), "99.999");
        assert_eq!(
            [below_100(1.0, 3), below_100(0.5, 1), below_100(0.9999, 1)],
            ["100.000", "50.0", "99.99"]
        );
        assert!(below_100(1.0 - f64::EPSILON / 2.0, 0).len() < 20);
    }
}
