//! [`ChartPanel`]: series of points on a pair of axes, and the drawing of grid, axes, series and labels.

use crate::axis::{Axis, FittedAxis};
use crate::canvas::{Anchor, Canvas};
use crate::label::{LabelLayout, nearest};
use crate::primitives::{Area, Colour, FAINT, GREY, INK, Position, RADIUS, WHITE};
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
    /// Label beside the point; may be empty.
    pub label: String,
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
const LABEL_SIZE: f32 = 11.0;
/// Room for the labels of the axes, px.
const LEFT: f32 = 76.0;
const BELOW: f32 = 50.0;
/// Points of a series that are closer than this share a label, px.
const NEAR: f32 = 16.0;

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
    // Lines are drawn first and labels last, over all series: no line covers a marker, and labels avoid everything that
    // was drawn before. Faded markers are below the others.
    let mut layout = LabelLayout { within: area, occupied: Vec::new(), lines: Vec::new() };
    placed.iter().for_each(|series| series.line(canvas, &mut layout));
    placed.iter().for_each(|series| series.intervals(canvas, &mut layout, place));
    placed.iter().for_each(|series| series.markers(canvas, &mut layout, true));
    placed.iter().for_each(|series| series.markers(canvas, &mut layout, false));
    placed.iter().for_each(|series| series.labels(canvas, &mut layout));
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

    fn line(&self, canvas: &mut Canvas, layout: &mut LabelLayout) {
        if self.drawn != SeriesStyle::Markers {
            layout.lines.extend(self.points.windows(2).map(|pair| (pair[0].0, pair[1].0)));
            let points: Vec<Position> = self.points.iter().map(|(spot, _)| *spot).collect();
            self.style.line(canvas, &points);
        }
    }

    fn intervals(&self, canvas: &mut Canvas, layout: &mut LabelLayout, place: impl Fn(f64) -> f32) {
        for ((x, _), point) in &self.points {
            if let Some(bounds) = point.bounds() {
                let [low, high] = bounds.map(&place);
                layout.lines.push(((*x, low), (*x, high)));
                self.style.interval(canvas, *x, (low, high), point.is_faded);
            }
        }
    }

    fn markers(&self, canvas: &mut Canvas, layout: &mut LabelLayout, is_faded: bool) {
        if self.drawn != SeriesStyle::Line {
            for (spot, point) in self.points.iter().filter(|(_, point)| point.is_faded == is_faded) {
                layout.mark(*spot);
                self.style.mark(canvas, *spot, is_faded, &point.hover);
            }
        }
    }

    fn labels(&self, canvas: &mut Canvas, layout: &mut LabelLayout) {
        for (spot, text, is_faded) in groups(&self.points) {
            note(canvas, layout, self.style.text_colour(is_faded), spot, &text);
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
    canvas.turned((edge + 12.0, height), &panel.y.label, 12.5, INK, (Anchor::Middle, true));
}

/// Labels of a series. Points that are close to each other share one at their middle: "2, 3" or "1.5 to 4".
fn groups(points: &[(Position, &DataPoint)]) -> Vec<(Position, String, bool)> {
    let mut groups: Vec<Vec<&(Position, &DataPoint)>> = Vec::new();
    for labelled in points.iter().filter(|(_, point)| !point.label.is_empty()) {
        match groups.last_mut() {
            Some(group) if near(group[0], labelled) => group.push(labelled),
            _ => groups.push(vec![labelled]),
        }
    }
    let text = |group: &[&(Position, &DataPoint)]| match group {
        [one] => one.1.label.clone(),
        [one, two] => format!("{}, {}", one.1.label, two.1.label),
        _ => format!("{} to {}", group[0].1.label, group[group.len() - 1].1.label),
    };
    groups.iter().map(|group| (group[group.len() / 2].0, text(group), group[0].1.is_faded)).collect()
}

fn near(a: &(Position, &DataPoint), b: &(Position, &DataPoint)) -> bool {
    a.1.is_faded == b.1.is_faded && distance(a.0, b.0) < NEAR
}

/// Writes a label where there is room, with a thin line to its point if it is not beside it.
fn note(canvas: &mut Canvas, layout: &mut LabelLayout, colour: Colour, spot: Position, text: &str) {
    let size = (canvas.font.width(text, LABEL_SIZE), LABEL_SIZE);
    let Some(area) = layout.place(spot, size) else { return };
    let edge = nearest(spot, area);
    if distance(edge, spot) > RADIUS + 9.0 {
        canvas.line(&[spot, edge], colour, 0.6, 0.0);
    }
    // If a label cannot avoid a line, the line is interrupted behind the label.
    canvas.block(area, WHITE);
    canvas.text((area.0, area.3 - LABEL_SIZE * 0.14), text, LABEL_SIZE, colour, Anchor::Start);
}

fn distance(a: Position, b: Position) -> f32 {
    (a.0 - b.0).hypot(a.1 - b.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_points_share_a_label() {
        let labelled = |label: &str| DataPoint { label: label.to_owned(), ..DataPoint::default() };
        let points = ["1.5", "2", "3", "4", "8"].map(labelled);
        let spots = [0.0, 5.0, 9.0, 80.0, 90.0].map(|x| (x, 0.0));
        let placed: Vec<(Position, &DataPoint)> = spots.into_iter().zip(&points).collect();
        let texts: Vec<String> = groups(&placed).into_iter().map(|(_, text, _)| text).collect();
        assert_eq!(texts, ["1.5 to 3", "4, 8"]);
    }
}
