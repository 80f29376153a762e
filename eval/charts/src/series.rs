//! [`Panel`]: series of points on a pair of axes, as data.

use crate::Axis;

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
