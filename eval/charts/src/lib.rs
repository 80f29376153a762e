//! Charts as SVG and PNG, and the frame of an HTML page. The font is embedded in the program.
//!
//! A [`Chart`] is data; [`Chart::svg`] and [`Chart::png`] draw the same shapes. The palette is that of Okabe and Ito,
//! markers distinguish the series without colour, and labels never overlap. No file is read or written.

mod axis;
mod bars;
mod canvas;
mod chart;
mod font;
mod html;
mod label;
mod legend;
mod palette;
mod panel;
mod picture;
mod pictures;
mod plates;
mod primitives;
mod raster;
mod series;
mod sheet;
mod style;
mod svg;

pub use axis::{Axis, Direction, Scale, Unit};
pub use bars::{Bar, Bars};
pub use chart::{Body, Chart, PageWidth, distinct};
pub use html::html_page;
pub use palette::class_colour;
pub use picture::{LabelledBox, Picture};
pub use pictures::Pictures;
pub use series::{Emphasis, Panel, Point, Series, SeriesStyle};
pub use sheet::sheet;

/// Error of a chart.
#[derive(Debug, thiserror::Error)]
pub enum ChartError {
    /// A picture with this number of columns and rows is empty or too large.
    #[error("a chart of {0} x {1} px cannot be painted")]
    Size(u32, u32),
    /// The number of samples does not fit the number of columns and rows.
    #[error("a picture of {0} x {1} px has {2} samples, three a pixel are needed")]
    Picture(u32, u32, usize),
    /// The picture cannot be encoded.
    #[error("chart: {0}")]
    Encode(#[from] image::ImageError),
}
