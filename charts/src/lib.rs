//! Charts as SVG and PNG, on any machine: the font is in the program.
//!
//! A [`Chart`] is data; [`Chart::svg`] and [`Chart::png`] draw the same shapes.
//! Colours are those of Okabe and Ito, markers tell the series apart without
//! them, and labels never lie on each other. Nothing here knows what is charted,
//! and no file is read or written.

mod axis;
mod canvas;
mod chart;
mod error;
mod font;
mod label;
mod legend;
mod panel;
mod raster;
mod style;
mod svg;

pub use axis::{Axis, Direction, Scale, Unit};
pub use chart::{Chart, Look, Panel, Point, Series, Tone};
pub use error::ChartError;
