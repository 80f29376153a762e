//! Charts as SVG and PNG, on any machine: the font is in the program.
//!
//! A [`Chart`] is data; [`Chart::svg`] and [`Chart::png`] draw the same shapes.
//! Colours are those of Okabe and Ito, markers tell the series apart without
//! them, and labels never lie on each other. Nothing here knows a method.

mod axis;
mod canvas;
mod font;
mod frontier;
mod label;
mod legend;
mod panel;
mod raster;
mod style;
mod svg;

use std::path::Path;

pub use axis::{Axis, Direction, Scale, Unit};
pub use frontier::{draw_frontier, frontier_from};

use crate::StudyError;
use crate::store::write;
use canvas::{Anchor, Canvas, GREY, INK};

/// One or more panels side by side with a common legend.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// One line.
    pub title: String,
    /// What was measured on what; wrapped where it is long.
    pub subtitle: String,
    /// How to read it; wrapped where it is long.
    pub footer: String,
    /// From left to right.
    pub panels: Vec<Panel>,
}

/// A pair of axes and what is drawn on them.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Across.
    pub x: Axis,
    /// Upwards.
    pub y: Axis,
    /// Series of the same name look the same in all panels.
    pub series: Vec<Series>,
}

/// Points joined by a line.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Stands in the legend.
    pub name: String,
    /// In the order in which the line joins them.
    pub points: Vec<Point>,
}

/// One marker.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Across, in the unit of the axis; a point that is not finite is left out.
    pub x: f64,
    /// Upwards, in the unit of the axis.
    pub y: f64,
    /// Written beside it; may be empty.
    pub label: String,
}

/// Why there is no PNG.
#[derive(Debug, thiserror::Error)]
pub enum ChartError {
    /// The embedded font.
    #[error("the font of the charts cannot be read: {0}")]
    Font(#[from] ttf_parser::FaceParsingError),
    /// More pixels than fit.
    #[error("a chart of {width} x {height} px cannot be painted")]
    Size {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The encoder refused.
    #[error("chart: {0}")]
    Encode(#[from] image::ImageError),
}

const WIDTH: f32 = 1200.0;
const MARGIN: f32 = 24.0;
/// Height of a panel with its axis.
const PANEL: f32 = 470.0;

impl Chart {
    /// The chart as SVG 1.1.
    ///
    /// # Errors
    /// [`ChartError::Font`].
    pub fn svg(&self) -> Result<String, ChartError> {
        Ok(svg::text(&self.canvas()?))
    }

    /// The same as PNG, twice the pixels of the SVG along each side.
    ///
    /// # Errors
    /// [`ChartError`].
    pub fn png(&self) -> Result<Vec<u8>, ChartError> {
        raster::png(&self.canvas()?)
    }

    /// Writes `STEM.svg` and `STEM.png`.
    ///
    /// # Errors
    /// [`StudyError`] when it cannot be drawn or written.
    pub fn save(&self, stem: &Path) -> Result<(), StudyError> {
        write(&stem.with_extension("svg"), self.svg()?.as_bytes())?;
        write(&stem.with_extension("png"), &self.png()?)
    }

    fn canvas(&self) -> Result<Canvas, ChartError> {
        let font = font::Font::new()?;
        let names = self.names();
        let mut canvas = Canvas::new(WIDTH, font);
        let mut y = MARGIN + 18.0;
        canvas.text((MARGIN, y), &self.title, 20.0, INK, Anchor::Start);
        y = canvas.paragraph((MARGIN, y + 22.0), &self.subtitle, 12.5, GREY);
        let width = (WIDTH - MARGIN) / self.panels.len().max(1) as f32;
        for (panel, index) in self.panels.iter().zip(0u8..) {
            let left = MARGIN + width * f32::from(index);
            panel::draw(&mut canvas, panel, &names, (left, y, width - MARGIN, PANEL));
        }
        y = legend::draw(&mut canvas, &names, (MARGIN, y + PANEL + 16.0));
        y = canvas.paragraph((MARGIN, y + 8.0), &self.footer, 11.0, GREY);
        canvas.height = (y + MARGIN / 2.0).ceil();
        Ok(canvas)
    }

    /// Names of the series, in the order of their first appearance.
    fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for series in self.panels.iter().flat_map(|panel| &panel.series) {
            if !names.contains(&series.name.as_str()) {
                names.push(&series.name);
            }
        }
        names
    }
}
