//! [`ChartPanel`]: series of points on a pair of axes, and the drawing of grid, axes and series.

use crate::axis::{Axis, FittedAxis};
use crate::canvas::{Anchor, Canvas};
use crate::primitives::{Area, FAINT, GREY, INK, Position, RADIUS};
use crate::style::Style;

/// A pair of axes with series.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartPanel {
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
    pub points: Vec<DataPoint>,
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

/// A point of a series.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DataPoint {
    /// Horizontal value. A point that is not finite is left out.
    pub x: f64,
    /// Vertical value.
    pub y: f64,
    /// Bounds of the interval of `y`, drawn as a vertical bar.
    pub interval: Option<[f64; 2]>,
    /// Text that the SVG shows while the pointer is on the point; may be empty.
    pub hover: String,
    /// Whether the marker is grey, and has not the colour of its series.
    pub is_faded: bool,
}

impl DataPoint {
    /// The bounds of the interval, if they are finite.
    fn bounds(&self) -> Option<[f64; 2]> {
        self.interval.filter(|bounds| bounds.iter().all(|bound| bound.is_finite()))
    }
}

const TICK: f32 = 11.5;
/// Room for the labels of the axes, px.
const LEFT: f32 = 76.0;
const BELOW: f32 = 50.0;

/// Share of the distance of two settings over which the points of one setting are spread.
const SPREAD: f32 = 0.7;

/// Height of a panel with its axis.
const HEIGHT: f32 = 470.0;
/// Height of a panel if there are more than [`FEW`].
const LOW: f32 = 270.0;
const FEW: usize = 3;
/// Distance between panels, px.
const GAP: f32 = 24.0;
/// Least width of a panel, px.
const LEAST: f32 = 350.0;

/// Draws `panels` into (left, top, width), side by side as far as there is room. Returns the y below them.
pub fn draw_all(canvas: &mut Canvas, panels: &[ChartPanel], (left, top, width): (f32, f32, f32)) -> f32 {
    let height = if panels.len() > FEW { LOW } else { HEIGHT };
    let columns = ((width / LEAST) as usize).clamp(1, panels.len().max(1));
    let column = width / columns as f32;
    for (index, panel) in panels.iter().enumerate() {
        let x = left + column * (index % columns) as f32;
        let y = top + (height + GAP) * (index / columns) as f32;
        draw(canvas, panel, (x, y, column - GAP, height));
    }
    let rows = panels.len().div_ceil(columns) as f32;
    top + rows * height + (rows - 1.0).max(0.0) * GAP
}

fn draw(canvas: &mut Canvas, panel: &ChartPanel, (left, top, width, height): Area) {
    let area = (left + LEFT, top, left + width, top + height - BELOW);
    let points = || panel.series.iter().flat_map(|series| &series.points).filter(|point| is_finite(point));
    let x = panel.x.fit(points().map(|point| point.x));
    let y = panel
        .y
        .fit(points().flat_map(|point| [point.y].into_iter().chain(point.bounds().into_iter().flatten())));
    grid(canvas, area, &x, &y);
    titles(canvas, panel, area, left);
    let place = |value: f64| area.3 - y.place(value) * (area.3 - area.1);
    // Series of equal values would cover each other: at each setting they are side by side, in the order of the legend.
    let (count, room) = (panel.series.len() as f32, x.step() * (area.2 - area.0));
    // Between two axes of settings, the value of y tells the series apart.
    let room = if y.step() > 0.0 { 0.0 } else { room };
    let apart = (SPREAD * room / (count - 1.0).max(1.0)).min(2.2 * RADIUS);
    let placed = panel.series.iter().enumerate().map(|(index, series)| {
        let aside = apart * (index as f32 - (count - 1.0) / 2.0);
        let x = |value: f64| area.0 + x.place(value) * (area.2 - area.0) + aside;
        Placed::new(series, |point| (x(point.x), place(point.y)))
    });
    let placed: Vec<Placed<'_>> = placed.collect();
    // Lines are drawn first, over all series: no line covers a marker. Faded markers are below the others.
    placed.iter().for_each(|series| series.line(canvas));
    placed.iter().for_each(|series| series.intervals(canvas, place));
    placed.iter().for_each(|series| series.markers(canvas, true));
    placed.iter().for_each(|series| series.markers(canvas, false));
}

struct Placed<'a> {
    style: Style,
    drawn: SeriesStyle,
    points: Vec<(Position, &'a DataPoint)>,
}

impl<'a> Placed<'a> {
    fn new(series: &'a Series, spot: impl Fn(&DataPoint) -> Position) -> Self {
        let finite = series.points.iter().filter(|point| is_finite(point));
        let points = finite.map(|point| (spot(point), point)).collect();
        Self { style: Style::of(&series.name), drawn: series.style, points }
    }

    fn line(&self, canvas: &mut Canvas) {
        if self.drawn != SeriesStyle::Markers {
            let points: Vec<Position> = self.points.iter().map(|(spot, _)| *spot).collect();
            self.style.line(canvas, &points);
        }
    }

    fn intervals(&self, canvas: &mut Canvas, place: impl Fn(f64) -> f32) {
        for ((x, _), point) in &self.points {
            if let Some(bounds) = point.bounds() {
                let [low, high] = bounds.map(&place);
                self.style.interval(canvas, *x, (low, high), point.is_faded);
            }
        }
    }

    fn markers(&self, canvas: &mut Canvas, is_faded: bool) {
        if self.drawn != SeriesStyle::Line {
            for (spot, point) in self.points.iter().filter(|(_, point)| point.is_faded == is_faded) {
                self.style.mark(canvas, *spot, is_faded, &point.hover);
            }
        }
    }
}

fn is_finite(point: &DataPoint) -> bool {
    point.x.is_finite() && point.y.is_finite()
}

fn grid(canvas: &mut Canvas, (left, top, right, bottom): Area, x: &FittedAxis, y: &FittedAxis) {
    for (value, text) in &x.ticks {
        let at = left + x.place(*value) * (right - left);
        canvas.line(&[(at, top), (at, bottom)], FAINT, 1.0, 0.0);
        canvas.text((at, bottom + 17.0), text, TICK, GREY, Anchor::Middle);
    }
    for (value, text) in &y.ticks {
        let at = bottom - y.place(*value) * (bottom - top);
        canvas.line(&[(left, at), (right, at)], FAINT, 1.0, 0.0);
        canvas.text((left - 7.0, at + TICK * 0.36), text, TICK, GREY, Anchor::End);
    }
    canvas.line(&[(left, top), (left, bottom), (right, bottom)], GREY, 1.2, 0.0);
}

fn titles(canvas: &mut Canvas, panel: &ChartPanel, (left, top, right, bottom): Area, edge: f32) {
    let (middle, height) = ((left + right) / 2.0, (top + bottom) / 2.0);
    canvas.text((middle, bottom + 38.0), &panel.x.label, 12.5, INK, Anchor::Middle);
    canvas.text((edge + 12.0, height), &panel.y.label, 12.5, INK, Anchor::Upwards);
}
