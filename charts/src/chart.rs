//! [`Chart`]: panels beside each other, with one legend.

use crate::canvas::{Anchor, Canvas, GREY, INK};
use crate::{Axis, ChartError, font, legend, panel, raster, svg};

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

/// Points of one kind.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Stands in the legend.
    pub name: String,
    /// In the order in which the line joins them.
    pub points: Vec<Point>,
    /// What is drawn of them.
    pub look: Look,
}

/// What is drawn of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// Markers and a line through them.
    Joined,
    /// Markers alone.
    Marks,
    /// The line alone.
    Line,
}

/// How much a marker stands out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tone {
    /// In the colour of its series.
    #[default]
    Full,
    /// In grey: there, but not the point.
    Faded,
}

/// One marker.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Point {
    /// Across, in the unit of the axis; a point that is not finite is left out.
    pub x: f64,
    /// Upwards, in the unit of the axis.
    pub y: f64,
    /// Written beside it; may be empty.
    pub label: String,
    /// Shown while a pointer is on it, in the SVG; may be empty.
    pub hover: String,
    /// How much it stands out.
    pub tone: Tone,
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

    /// Names and looks of the series, in the order of their first appearance.
    fn names(&self) -> Vec<(&str, Look)> {
        let mut names: Vec<(&str, Look)> = Vec::new();
        for series in self.panels.iter().flat_map(|panel| &panel.series) {
            if names.iter().all(|(name, _)| *name != series.name) {
                names.push((&series.name, series.look));
            }
        }
        names
    }
}
