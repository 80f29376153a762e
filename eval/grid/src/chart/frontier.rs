//! Speed against accuracy.

use modulo_draw::{Axis, ChartPanel, DataPoint, Scale, Series, SeriesStyle};
use modulo_runtime::SensorModel;

use super::pareto::{Candidate, pareto_front};
use super::{NamedChart, models};
use crate::labels::{self, distinct, number};
use crate::results::{Cell, Results};

/// Name of the line in the legend.
const FRONT: &str = "Pareto front";

/// Speed against accuracy: one chart for each alpha, the alpha nearest to 4 first, with a point for each model, stream and
/// method.
pub fn charts(results: &Results, conditions: &SensorModel) -> Vec<NamedChart> {
    let own = |cell: &&Cell| labels::belongs(&cell.point, conditions) && labels::frame_ms(cell).is_some();
    let cells: Vec<&Cell> = results.cells.iter().filter(own).collect();
    let mut alphas = distinct(cells.iter().map(|cell| cell.point.sensor.alpha));
    alphas.sort_by(|a, b| (a - 4.0).abs().total_cmp(&(b - 4.0).abs()));
    alphas.into_iter().map(|alpha| frontier(results, &cells, alpha, conditions)).collect()
}

fn frontier(results: &Results, cells: &[&Cell], alpha: f64, conditions: &SensorModel) -> NamedChart {
    let cells: Vec<&Cell> = cells.iter().filter(|cell| cell.point.sensor.alpha == alpha).copied().collect();
    let groups = distinct(cells.iter().flat_map(|cell| cell.ap50.keys()));
    let footer = "Time: median of unwrap, tone or deblur, pre, infer and post together; the capture and the \
                 simulation of the sensor are not in it. Bars: 95 % bootstrap intervals of AP50. Grey: another choice is more accurate beyond the 95 % \
                 intervals of both, and not slower. No sensor delivers the ideal streams: they are not on the front. \
                 Towards the upper left is better.";
    let title = format!("Speed against accuracy, alpha {alpha}, {}", labels::conditions(conditions));
    let panels = groups.iter().map(|group| frontier_panel(&cells, group)).collect();
    let name = format!("frontier_alpha{alpha}_{}", labels::suffix(conditions, &["alpha"]));
    NamedChart::new(name, title, results, footer, panels)
}

fn frontier_panel(cells: &[&Cell], group: &str) -> ChartPanel {
    let scored: Vec<(&Cell, Candidate)> =
        cells.iter().filter_map(|cell| Some((*cell, candidate(cell, group)?))).collect();
    // An ideal image is more accurate than every image that a sensor delivers. On the front it would dominate all real
    // choices.
    let real: Vec<&(&Cell, Candidate)> = scored.iter().filter(|(cell, _)| is_choice(cell)).collect();
    let front = pareto_front(&real.iter().map(|(_, candidate)| *candidate).collect::<Vec<_>>());
    let front: Vec<&(&Cell, Candidate)> = front.into_iter().map(|index| real[index]).collect();
    let several = models(cells).len() > 1;
    let mut series: Vec<Series> = Vec::new();
    for (cell, (cost, gain)) in &scored {
        let kept = !is_choice(cell) || !real.iter().any(|(other, _)| beats(other, cell, group));
        let (stream, model) = (labels::stream(&cell.point), labels::model(&cell.point));
        let name = if several { format!("{stream}, {model}") } else { stream.clone() };
        let (ms, percent) = (number(*cost, 1), number(100.0 * gain, 1));
        let point = DataPoint {
            x: *cost,
            y: *gain,
            interval: cell.interval_of(group),
            hover: format!("{stream}, {model}: {ms} ms, AP50 of {group} {percent} %"),
            is_faded: !kept,
        };
        match series.iter_mut().find(|series| series.name == name) {
            Some(series) => series.points.push(point),
            None => series.push(Series { name, points: vec![point], style: SeriesStyle::Markers }),
        }
    }
    series.push(Series { name: FRONT.to_owned(), points: steps(&front), style: SeriesStyle::Line });
    let timed = labels::frames(cells, |cell| cell.frame_ms.as_ref().map(|time| time.frames));
    ChartPanel {
        x: Axis::new(Scale::Log, format!("median time of a frame, ms, {timed}")),
        y: Axis::new(Scale::Share, labels::ap50(group, cells)),
        series,
    }
}

fn candidate(cell: &Cell, group: &str) -> Option<Candidate> {
    Some((labels::frame_ms(cell)?, cell.ap50_of(group)?))
}

/// Whether a cell is more accurate than another one measured in the same pass, beyond the 95 % intervals of both, and not
/// slower, within them.
fn beats(cell: &Cell, other: &Cell, group: &str) -> bool {
    let (Some(time), Some(others)) = (&cell.frame_ms, &other.frame_ms) else { return false };
    let (Some([low, _]), Some([_, high])) = (cell.interval_of(group), other.interval_of(group)) else {
        return false;
    };
    time.pass == others.pass && time.interval95[0] <= others.interval95[1] && low > high
}

/// Whether a real camera can deliver the image of a cell.
fn is_choice(cell: &Cell) -> bool {
    !cell.point.is("ideal")
}

/// The best gain at each time, as a step function.
fn steps(front: &[&(&Cell, Candidate)]) -> Vec<DataPoint> {
    let at = |x: f64, y: f64| DataPoint { x, y, ..DataPoint::default() };
    let mut points: Vec<DataPoint> = Vec::new();
    for (_, (cost, gain)) in front {
        // Between two choices, the best gain is that of the faster one, so that the line goes right before it goes up.
        if let Some(last) = points.last().map(|point| point.y) {
            points.push(at(*cost, last));
        }
        points.push(at(*cost, *gain));
    }
    points
}
