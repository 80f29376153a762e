//! Speed against accuracy at one alpha: a point for each model, stream and method.

use modulo_charts::{Axis, ChartBody, ChartPanel, DataPoint, Emphasis, Series, SeriesStyle};

use super::{NamedChart, add_point, models, suffix};
use crate::labels::{self, Conditions, distinct};
use crate::pareto::{self, Candidate};
use crate::results::{Cell, Results, Stream};

/// Name of the line in the legend.
const FRONT: &str = "Pareto front";

/// One chart for each alpha, the alpha nearest to 4 first.
pub fn charts(results: &Results, conditions: Conditions) -> Vec<NamedChart> {
    let mut cells = super::cells(results, conditions);
    cells.retain(|cell| labels::frame_ms(cell).is_some());
    let mut alphas = distinct(cells.iter().map(|cell| cell.point.alpha));
    alphas.sort_by(|a, b| (a - 4.0).abs().total_cmp(&(b - 4.0).abs()));
    alphas.into_iter().map(|alpha| chart(results, &cells, alpha, conditions)).collect()
}

fn chart(results: &Results, cells: &[&Cell], alpha: f64, conditions: Conditions) -> NamedChart {
    let cells: Vec<&Cell> = cells.iter().filter(|cell| cell.point.alpha == alpha).copied().collect();
    let groups = distinct(cells.iter().flat_map(|cell| cell.ap50.keys()));
    let footer = "Time: the sum of the medians of unwrap, tone or deblur, pre, infer and post; the capture and the \
                 simulation of the sensor are not in it. Grey: dominated, something else is both faster and more \
                 accurate. The ideal streams are no choice, for no sensor delivers them: they are not on the front. \
                 Towards the upper left is better.";
    let title = format!("Speed against accuracy, alpha {alpha}, {}", labels::conditions(conditions));
    let body = ChartBody::Panels(groups.iter().map(|group| panel(&cells, group)).collect());
    let name = format!("frontier_alpha{alpha}_{}", suffix(conditions));
    NamedChart::new(name, title, results, footer.to_owned(), body)
}

fn panel(cells: &[&Cell], group: &str) -> ChartPanel {
    let scored: Vec<(&Cell, Candidate)> =
        cells.iter().filter_map(|cell| Some((*cell, candidate(cell, group)?))).collect();
    let real: Vec<&(&Cell, Candidate)> = scored.iter().filter(|(cell, _)| is_choice(cell)).collect();
    let front = pareto::front(&real.iter().map(|(_, candidate)| *candidate).collect::<Vec<_>>());
    let front: Vec<&(&Cell, Candidate)> = front.into_iter().map(|index| real[index]).collect();
    let several = models(cells).len() > 1;
    let mut series: Vec<Series> = Vec::new();
    for (cell, candidate) in &scored {
        let kept = !is_choice(cell) || front.iter().any(|(other, _)| std::ptr::eq(*other, *cell));
        let name = labels::stream(&cell.point);
        let model = labels::model(&cell.point);
        let point = DataPoint {
            x: candidate.cost,
            y: candidate.gain,
            hover: format!(
                "{name}, {model}: {:.1} ms, AP50 of {group} {:.1} %",
                candidate.cost,
                100.0 * candidate.gain
            ),
            label: if several { model } else { name.clone() },
            emphasis: if kept { Emphasis::Normal } else { Emphasis::Faded },
        };
        add_point(&mut series, name, point, SeriesStyle::Markers);
    }
    series.push(Series { name: FRONT.to_owned(), points: steps(&front), style: SeriesStyle::Line });
    ChartPanel {
        x: Axis::log("time a frame, ms (median)"),
        y: Axis::percent(format!("AP50 of {group}"), 1.0),
        series,
    }
}

fn candidate(cell: &Cell, group: &str) -> Option<Candidate> {
    Some(Candidate { cost: labels::frame_ms(cell)?, gain: (*cell.ap50.get(group)?)? })
}

/// Whether a real camera can deliver the image of a cell.
fn is_choice(cell: &Cell) -> bool {
    cell.point.stream != Stream::Ideal
}

/// The best gain at each time, as a step function.
fn steps(front: &[&(&Cell, Candidate)]) -> Vec<DataPoint> {
    let at = |x: f64, y: f64| DataPoint { x, y, ..DataPoint::default() };
    let mut points: Vec<DataPoint> = Vec::new();
    for (_, Candidate { cost, gain }) in front {
        if let Some(last) = points.last().map(|point| point.y) {
            points.push(at(*cost, last));
        }
        points.push(at(*cost, *gain));
    }
    points
}
