//! Charts as SVG and PNG, on any machine: the font is in the program.
//!
//! A [`Chart`] is data; [`Chart::svg`] and [`Chart::png`] draw the same shapes.
//! Colours are those of Okabe and Ito, markers tell the series apart without
//! them, and labels never lie on each other. Nothing here knows what is charted,
//! and no file is read or written.

mod axis;
mod bars;
mod canvas;
mod chart;
mod font;
mod label;
mod legend;
mod panel;
mod pictures;
mod raster;
mod series;
mod style;
mod svg;

pub use axis::{Axis, Direction, Scale, Unit};
pub use bars::{Bar, Bars};
pub use chart::{Body, Chart, Page};
pub use pictures::{Picture, Pictures};
pub use series::{Look, Panel, Point, Series, Tone};

/// Why there is no chart.
#[derive(Debug, thiserror::Error)]
pub enum ChartError {
    /// The embedded font.
    #[error("the font of the charts cannot be read: {0}")]
    Font(#[from] ttf_parser::FaceParsingError),
    /// A picture of so many columns and rows has no pixels, or more than fit.
    #[error("a chart of {0} x {1} px cannot be painted")]
    Size(u32, u32),
    /// A picture of so many columns and rows has another number of samples.
    #[error("a picture of {0} x {1} px has {2} samples, three a pixel are needed")]
    Picture(u32, u32, usize),
    /// The encoder refused.
    #[error("chart: {0}")]
    Encode(#[from] image::ImageError),
}
