//! Speed against accuracy: a point a model, stream and method, at one alpha.

use modulo_charts::{Axis, Body, Look, Panel, Point, Series, Tone};

use super::{Named, suffix};
use crate::pareto::{self, Offer};
use crate::results::{Cell, Results, Stream};
use crate::wording::{self, Conditions, distinct};

/// Stands in the legend for the line.
const FRONT: &str = "Pareto front";

/// One for each alpha, from 4 downwards in distance.
pub fn charts(results: &Results, conditions: Conditions) -> Vec<Named> {
    let of = |cell: &&Cell| wording::belongs(&cell.point, conditions) && wording::frame_ms(cell).is_some();
    let cells: Vec<&Cell> = results.cells.iter().filter(of).collect();
    let mut alphas = distinct(cells.iter().map(|cell| cell.point.alpha));
    alphas.sort_by(|a, b| (a - 4.0).abs().total_cmp(&(b - 4.0).abs()));
    alphas.into_iter().map(|alpha| chart(results, &cells, alpha, conditions)).collect()
}

fn chart(results: &Results, cells: &[&Cell], alpha: f64, conditions: Conditions) -> Named {
    let cells: Vec<&Cell> = cells.iter().filter(|cell| cell.point.alpha == alpha).copied().collect();
    let groups = distinct(cells.iter().flat_map(|cell| cell.ap50.keys()));
    let footer = "Time: the sum of the medians of unwrap, tone or deblur, pre, infer and post; the capture and the \
                 simulation of the sensor are not in it. Grey: dominated, something else is both faster and more \
                 accurate. The ideal streams are no choice, for no sensor delivers them: they are not on the front. \
                 Towards the upper left is better.";
    let title = format!("Speed against accuracy, alpha {alpha}, {}", wording::conditions(conditions));
    let body = Body::Panels(groups.iter().map(|group| panel(&cells, group)).collect());
    let name = format!("frontier_alpha{alpha}_{}", suffix(conditions));
    Named::new(name, title, results, footer.to_owned(), body)
}

fn panel(cells: &[&Cell], group: &str) -> Panel {
    let scored: Vec<(&Cell, Offer)> =
        cells.iter().filter_map(|cell| Some((*cell, offer(cell, group)?))).collect();
    let real: Vec<&(&Cell, Offer)> = scored.iter().filter(|(cell, _)| is_choice(cell)).collect();
    let front = pareto::front(&real.iter().map(|(_, offer)| *offer).collect::<Vec<_>>());
    let front: Vec<&(&Cell, Offer)> = front.into_iter().map(|index| real[index]).collect();
    let several = distinct(cells.iter().map(|cell| wording::model(&cell.point))).len() > 1;
    let mut series: Vec<Series> = Vec::new();
    for (cell, offer) in &scored {
        let kept = !is_choice(cell) || front.iter().any(|(other, _)| std::ptr::eq(*other, *cell));
        let name = wording::stream(&cell.point);
        let model = wording::model(&cell.point);
        let point = Point {
            x: offer.cost,
            y: offer.gain,
            hover: format!(
                "{name}, {model}: {:.1} ms, AP50 of {group} {:.1} %",
                offer.cost,
                100.0 * offer.gain
            ),
            label: if several { model } else { name.clone() },
            tone: if kept { Tone::Full } else { Tone::Faded },
        };
        match series.iter_mut().find(|series| series.name == name) {
            Some(series) => series.points.push(point),
            None => series.push(Series { name, points: vec![point], look: Look::Marks }),
        }
    }
    series.push(Series { name: FRONT.to_owned(), points: steps(&front), look: Look::Line });
    Panel {
        x: Axis::log("time a frame, ms (median)"),
        y: Axis::percent(format!("AP50 of {group}"), 1.0),
        series,
    }
}

fn offer(cell: &Cell, group: &str) -> Option<Offer> {
    Some(Offer { cost: wording::frame_ms(cell)?, gain: (*cell.ap50.get(group)?)? })
}

/// Whether a real camera can deliver it.
fn is_choice(cell: &Cell) -> bool {
    cell.point.stream != Stream::Ideal
}

/// What can be had at each time: level until the next choice.
fn steps(front: &[&(&Cell, Offer)]) -> Vec<Point> {
    let at = |x: f64, y: f64| Point { x, y, ..Point::default() };
    let mut points: Vec<Point> = Vec::new();
    for (_, Offer { cost, gain }) in front {
        if let Some(last) = points.last().map(|point| point.y) {
            points.push(at(*cost, last));
        }
        points.push(at(*cost, *gain));
    }
    points
}
