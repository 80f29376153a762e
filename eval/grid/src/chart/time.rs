//! The charts of time: speed against accuracy, the stages of a frame, and the distribution of its time.

use modulo_draw::{Axis, Bar, Bars, ChartBody, ChartPanel, DataPoint, Emphasis, Series, SeriesStyle};

use super::{NamedChart, add_point, models, suffix};
use crate::budget::{Candidate, pareto_front};
use crate::labels::{self, Conditions, SENSE, STAGES, distinct, number};
use crate::results::{Cell, Results, Stream};

/// Name of the line in the legend.
const FRONT: &str = "Pareto front";

/// Speed against accuracy: one chart for each alpha, the alpha nearest to 4 first, with a point for each model, stream and
/// method.
pub fn frontiers(results: &Results, conditions: &Conditions) -> Vec<NamedChart> {
    let mut cells = super::cells(results, conditions);
    cells.retain(|cell| labels::frame_ms(cell).is_some());
    let mut alphas = distinct(cells.iter().map(|cell| cell.point.sensor.alpha));
    alphas.sort_by(|a, b| (a - 4.0).abs().total_cmp(&(b - 4.0).abs()));
    alphas.into_iter().map(|alpha| frontier(results, &cells, alpha, conditions)).collect()
}

fn frontier(results: &Results, cells: &[&Cell], alpha: f64, conditions: &Conditions) -> NamedChart {
    let cells: Vec<&Cell> = cells.iter().filter(|cell| cell.point.sensor.alpha == alpha).copied().collect();
    let groups = distinct(cells.iter().flat_map(|cell| cell.ap50.keys()));
    let footer = "Time: median of unwrap, tone or deblur, pre, infer and post together; the capture and the \
                 simulation of the sensor are not in it. Bars: 95 % bootstrap intervals of AP50. Grey: another choice is more accurate beyond the 95 % \
                 intervals of both, and not slower. No sensor delivers the ideal streams: they are not on the front. \
                 Towards the upper left is better.";
    let title = format!("Speed against accuracy, alpha {alpha}, {}", labels::conditions(conditions));
    let body = ChartBody::Panels(groups.iter().map(|group| frontier_panel(&cells, group)).collect());
    let name = format!("frontier_alpha{alpha}_{}", suffix(conditions));
    NamedChart::new(name, title, results, footer.to_owned(), body)
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
    for (cell, candidate) in &scored {
        let kept = !is_choice(cell) || !real.iter().any(|(other, _)| beats(other, cell, group));
        let name = labels::stream(&cell.point);
        let model = labels::model(&cell.point);
        let point = DataPoint {
            x: candidate.cost,
            y: candidate.gain,
            interval: cell.interval95.get(&format!("ap50.{group}")).copied(),
            hover: format!(
                "{name}, {model}: {} ms, AP50 of {group} {} %",
                number(candidate.cost, 1),
                number(100.0 * candidate.gain, 1)
            ),
            label: if several { model } else { name.clone() },
            emphasis: if kept { Emphasis::Normal } else { Emphasis::Faded },
        };
        add_point(&mut series, name, point, SeriesStyle::Markers);
    }
    series.push(Series { name: FRONT.to_owned(), points: steps(&front), style: SeriesStyle::Line });
    ChartPanel {
        x: Axis::log(format!("median time of a frame, ms, {}", labels::timed_frames(cells))),
        y: Axis::percent(labels::ap50(group, &labels::frames(cells.iter().map(|cell| cell.frames))), 1.0),
        series,
    }
}

fn candidate(cell: &Cell, group: &str) -> Option<Candidate> {
    Some(Candidate { cost: labels::frame_ms(cell)?, gain: (*cell.ap50.get(group)?)? })
}

/// Whether a cell is more accurate than another one measured in the same pass, beyond the 95 % intervals of both, and not
/// slower, within them.
fn beats(cell: &Cell, other: &Cell, group: &str) -> bool {
    let (Some(time), Some(others)) = (&cell.frame_ms, &other.frame_ms) else { return false };
    let key = format!("ap50.{group}");
    let (Some([low, _]), Some([_, high])) = (cell.interval95.get(&key), other.interval95.get(&key)) else {
        return false;
    };
    time.pass == others.pass && time.interval95[0] <= others.interval95[1] && low > high
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
        // Between two choices, the best gain is that of the faster one, so that the line goes right before it goes up.
        if let Some(last) = points.last().map(|point| point.y) {
            points.push(at(*cost, last));
        }
        points.push(at(*cost, *gain));
    }
    points
}

/// One chart at the alpha nearest to 4: the stages of a frame, a bar for each stream, method and model.
pub fn stages(results: &Results, conditions: &Conditions) -> Vec<NamedChart> {
    let mut cells = super::cells(results, conditions);
    cells.retain(|cell| labels::frame_ms(cell).is_some());
    let cells = labels::nearest_to_four(&cells);
    let Some(alpha) = cells.first().map(|cell| cell.point.sensor.alpha) else { return Vec::new() };
    let rows = cells.iter().map(|cell| bar(cell)).collect();
    let label = format!("median time of a frame, ms, {}", labels::timed_frames(&cells));
    let footer = "Medians over the frames of a cell, stage by stage. The capture and the simulation of the sensor are \
                 not in it.";
    let title = format!("Where the time of a frame goes, alpha {alpha}, {}", labels::conditions(conditions));
    let body = ChartBody::Bars(Bars { label, rows });
    let name = format!("latency_{}", suffix(conditions));
    vec![NamedChart::new(name, title, results, footer.to_owned(), body)]
}

fn bar(cell: &Cell) -> Bar {
    let label = format!("{}, {}", labels::stream(&cell.point), labels::model(&cell.point));
    let timed = |stage: &&str| Some(((*stage).to_owned(), cell.latency_ms.get(*stage)?.p50));
    let parts = STAGES.iter().filter(|stage| **stage != SENSE).filter_map(timed).collect();
    let note = labels::frame_ms(cell).map_or(String::new(), |ms| format!("{} ms", number(ms, 1)));
    Bar { label, parts, note }
}

/// Upper bound of a bucket divided by its lower bound: `10^(1 / 20)`.
const BUCKET: f64 = 1.122_018_454_301_963_3;

/// One chart at the alpha nearest to 4: the distribution of the time of a frame, with a panel for each model and a line
/// for each stream and method.
pub fn histograms(results: &Results, conditions: &Conditions) -> Vec<NamedChart> {
    let mut cells = super::cells(results, conditions);
    cells.retain(|cell| !cell.latency_histogram.is_empty());
    let cells = labels::nearest_to_four(&cells);
    let Some(alpha) = cells.first().map(|cell| cell.point.sensor.alpha) else { return Vec::new() };
    let footer = "Share of the frames that take at most this time, from the captured image to the boxes, in buckets of \
                 1/20 of a power of ten; the capture and the simulation of the sensor are not in it.";
    let title = format!("How long frames take, alpha {alpha}, {}", labels::conditions(conditions));
    let body = ChartBody::Panels(models(&cells).iter().map(|model| panel(&cells, model)).collect());
    let name = format!("histogram_{}", suffix(conditions));
    vec![NamedChart::new(name, title, results, footer.to_owned(), body)]
}

fn panel(cells: &[&Cell], model: &str) -> ChartPanel {
    let own = cells.iter().filter(|cell| labels::model(&cell.point) == model);
    ChartPanel {
        x: Axis::log(format!("time of a frame, ms, {model}")),
        y: Axis::percent(format!("share of frames, %, {}", labels::timed_frames(cells)), 1.0),
        series: own.map(|cell| series(cell)).collect(),
    }
}

/// The share of the frames up to each bound of the buckets. Single buckets would cover those of other cells.
fn series(cell: &Cell) -> Series {
    let all: u64 = cell.latency_histogram.iter().map(|(_, count)| count).sum();
    let (mut points, mut sum) = (Vec::new(), 0);
    for (bound, count) in &cell.latency_histogram {
        let share = |sum: u64| sum as f64 / all.max(1) as f64;
        let below = DataPoint { x: bound / BUCKET, y: share(sum), ..DataPoint::default() };
        sum += count;
        points.extend([below, DataPoint { x: *bound, y: share(sum), ..DataPoint::default() }]);
    }
    Series { name: labels::stream(&cell.point), points, style: SeriesStyle::Line }
}
