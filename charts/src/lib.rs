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
mod error;
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
pub use error::ChartError;
pub use pictures::{Picture, Pictures};
pub use series::{Look, Panel, Point, Series, Tone};
