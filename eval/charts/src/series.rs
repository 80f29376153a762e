//! [`Panel`]: series of points on a pair of axes.

use crate::Axis;

/// A pair of axes with series.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// The series. Those of one name have one style in all panels.
    pub series: Vec<Series>,
}

/// Points with a common name and style.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// The points in the order in which a line joins them.
    pub points: Vec<Point>,
    /// The style.
    pub style: SeriesStyle,
}

/// Style of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeriesStyle {
    /// Markers and a line through them.
    LineAndMarkers,
    /// Only markers.
    Markers,
    /// Only the line.
    Line,
}

/// Emphasis of a marker.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Emphasis {
    /// The marker has the colour of its series.
    #[default]
    Normal,
    /// The marker is grey.
    Faded,
}

/// A point of a series.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Point {
    /// Horizontal value. A point that is not finite is left out.
    pub x: f64,
    /// Vertical value.
    pub y: f64,
    /// Label beside the point; may be empty.
    pub label: String,
    /// Text that the SVG shows while the pointer is on the point; may be empty.
    pub hover: String,
    /// Emphasis.
    pub emphasis: Emphasis,
}
