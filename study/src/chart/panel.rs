//! One panel: grid, axes, series, labels at the points.

use super::axis::Ruler;
use super::canvas::{Anchor, Canvas, FAINT, GREY, INK, Shape, Spot, Turn, WHITE};
use super::label::{Area, Crowd, Wanted, nearest};
use super::style::{RADIUS, Style};
use super::{Panel, Point, Series};

const TICK: f32 = 11.5;
const NOTE: f32 = 11.0;
/// Room for the labels of the axes, px.
const LEFT: f32 = 76.0;
const BELOW: f32 = 50.0;
/// Points of a series nearer than this share a label, px.
const NEAR: f32 = 16.0;

/// Draws `panel` into (left, top, width, height); `names` gives each series its style.
pub fn draw(canvas: &mut Canvas, panel: &Panel, names: &[&str], (left, top, width, height): Area) {
    let area = (left + LEFT, top, left + width, top + height - BELOW);
    let points = || panel.series.iter().flat_map(|series| &series.points).filter(|point| is_finite(point));
    let x = panel.x.ruler(points().map(|point| point.x));
    let y = panel.y.ruler(points().map(|point| point.y));
    grid(canvas, area, &x, &y);
    titles(canvas, panel, area, left);
    let spot = |point: &Point| {
        let (across, up) = (x.place(point.x), y.place(point.y));
        (area.0 + across * (area.2 - area.0), area.3 - up * (area.3 - area.1))
    };
    let style =
        |series: &Series| Style::of(names.iter().position(|name| *name == series.name).unwrap_or_default());
    let mut crowd = Crowd { within: area, taken: Vec::new(), lines: Vec::new() };
    let mut marked: Vec<(Style, Vec<(Spot, &str)>)> = Vec::new();
    for series in &panel.series {
        let finite = series.points.iter().filter(|point| is_finite(point));
        let spots: Vec<_> = finite.map(|point| (spot(point), point.label.as_str())).collect();
        crowd.lines.extend(spots.windows(2).map(|pair| (pair[0].0, pair[1].0)));
        spots.iter().for_each(|(spot, _)| crowd.mark(*spot));
        style(series).line(canvas, spots.iter().map(|(spot, _)| *spot).collect());
        marked.push((style(series), spots));
    }
    for (style, spots) in &marked {
        spots.iter().for_each(|(spot, _)| style.mark(canvas, *spot));
    }
    for (style, spots) in &marked {
        groups(spots).into_iter().for_each(|(spot, text)| note(canvas, &mut crowd, *style, spot, &text));
    }
}

fn is_finite(point: &Point) -> bool {
    point.x.is_finite() && point.y.is_finite()
}

fn grid(canvas: &mut Canvas, (left, top, right, bottom): Area, x: &Ruler, y: &Ruler) {
    for (value, text) in &x.ticks {
        let at = left + x.place(*value) * (right - left);
        canvas.line(vec![(at, top), (at, bottom)], FAINT, 1.0);
        canvas.text((at, bottom + 17.0), text, TICK, GREY, Anchor::Middle);
    }
    for (value, text) in &y.ticks {
        let at = bottom - y.place(*value) * (bottom - top);
        canvas.line(vec![(left, at), (right, at)], FAINT, 1.0);
        canvas.text((left - 7.0, at + TICK * 0.36), text, TICK, GREY, Anchor::End);
    }
    canvas.line(vec![(left, top), (left, bottom), (right, bottom)], GREY, 1.2);
}

fn titles(canvas: &mut Canvas, panel: &Panel, (left, top, right, bottom): Area, edge: f32) {
    let (middle, height) = ((left + right) / 2.0, (top + bottom) / 2.0);
    canvas.text((middle, bottom + 38.0), &panel.x.label, 12.5, INK, Anchor::Middle);
    canvas.turned((edge + 12.0, height), &panel.y.label, 12.5, INK, (Anchor::Middle, Turn::Upwards));
}

/// Neighbours of a series that would share a place share a label: "2, 3" or "1.5 to 4", at their middle one.
fn groups(spots: &[(Spot, &str)]) -> Vec<(Spot, String)> {
    let mut groups: Vec<Vec<&(Spot, &str)>> = Vec::new();
    for labelled in spots.iter().filter(|(_, label)| !label.is_empty()) {
        match groups.last_mut() {
            Some(group) if distance(group[0].0, labelled.0) < NEAR => group.push(labelled),
            _ => groups.push(vec![labelled]),
        }
    }
    let text = |group: &[&(Spot, &str)]| match group {
        [one] => one.1.to_owned(),
        [one, two] => format!("{}, {}", one.1, two.1),
        _ => format!("{} to {}", group[0].1, group[group.len() - 1].1),
    };
    groups.iter().map(|group| (group[group.len() / 2].0, text(group))).collect()
}

/// Writes the label where there is room, with a thin line to its point when that is not beside it.
fn note(canvas: &mut Canvas, crowd: &mut Crowd, style: Style, spot: Spot, text: &str) {
    let wanted = Wanted { spot, width: canvas.font.width(text, NOTE), height: NOTE };
    let Some(area) = crowd.place(&wanted) else { return };
    let edge = nearest(spot, area);
    if distance(edge, spot) > RADIUS + 9.0 {
        canvas.line(vec![spot, edge], style.colour, 0.6);
    }
    // A line that had to pass there stops at the text.
    let corners = [(area.0, area.1), (area.2, area.1), (area.2, area.3), (area.0, area.3)];
    canvas.shapes.push(Shape::Area { spots: corners.to_vec(), colour: WHITE });
    canvas.text((area.0, area.3 - NOTE * 0.14), text, NOTE, style.colour, Anchor::Start);
}

fn distance(a: Spot, b: Spot) -> f32 {
    (a.0 - b.0).hypot(a.1 - b.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_points_share_a_label() {
        let spots = [
            ((0.0, 0.0), "1.5"),
            ((5.0, 0.0), "2"),
            ((9.0, 0.0), "3"),
            ((80.0, 0.0), "4"),
            ((90.0, 0.0), "8"),
        ];
        let texts: Vec<String> = groups(&spots).into_iter().map(|(_, text)| text).collect();
        assert_eq!(texts, ["1.5 to 3", "4, 8"]);
    }
}
