//! The time of a frame: its stages, and its distribution.

use modulo_charts::{Axis, Bar, Bars, ChartBody, ChartPanel, DataPoint, Series, SeriesStyle};

use super::{NamedChart, models, suffix};
use crate::labels::{self, Conditions, SENSE, STAGES};
use crate::results::{Cell, Results};

/// One chart at the alpha nearest to 4: the stages of a frame, a bar for each stream, method and model.
pub fn stages(results: &Results, conditions: Conditions) -> Vec<NamedChart> {
    let mut cells = super::cells(results, conditions);
    cells.retain(|cell| labels::frame_ms(cell).is_some());
    let cells = labels::nearest_to_four(&cells);
    let Some(alpha) = cells.first().map(|cell| cell.point.alpha) else { return Vec::new() };
    let rows = cells.iter().map(|cell| bar(cell)).collect();
    let footer = "Medians over the frames of a cell, stage by stage. The capture and the simulation of the sensor are \
                 not in it.";
    let title = format!("Where the time of a frame goes, alpha {alpha}, {}", labels::conditions(conditions));
    let body = ChartBody::Bars(Bars { label: "time a frame, ms".to_owned(), rows });
    let name = format!("latency_{}", suffix(conditions));
    vec![NamedChart::new(name, title, results, footer.to_owned(), body)]
}

fn bar(cell: &Cell) -> Bar {
    let label = format!("{}, {}", labels::stream(&cell.point), labels::model(&cell.point));
    let timed = |stage: &&str| Some(((*stage).to_owned(), cell.latency_ms.get(*stage)?.p50));
    let parts = STAGES.iter().filter(|stage| **stage != SENSE).filter_map(timed).collect();
    let note = labels::frame_ms(cell).map_or(String::new(), |ms| format!("{ms:.1} ms"));
    Bar { label, parts, note }
}

/// Upper bound of a bucket divided by its lower bound.
const BUCKET: f64 = 1.122_018_454_301_963_3;

/// One chart at the alpha nearest to 4: the histogram of the time of a frame, with a panel for each model and a line for
/// each stream and method.
pub fn histograms(results: &Results, conditions: Conditions) -> Vec<NamedChart> {
    let mut cells = super::cells(results, conditions);
    cells.retain(|cell| !cell.latency_histogram.is_empty());
    let cells = labels::nearest_to_four(&cells);
    let Some(alpha) = cells.first().map(|cell| cell.point.alpha) else { return Vec::new() };
    let footer = "Share of the frames in buckets of 1/20 of a power of ten. From the captured image to the boxes; the \
                 capture and the simulation of the sensor are not in it.";
    let title = format!("How long frames take, alpha {alpha}, {}", labels::conditions(conditions));
    let body = ChartBody::Panels(models(&cells).iter().map(|model| panel(&cells, model)).collect());
    let name = format!("histogram_{}", suffix(conditions));
    vec![NamedChart::new(name, title, results, footer.to_owned(), body)]
}

fn panel(cells: &[&Cell], model: &str) -> ChartPanel {
    let own = cells.iter().filter(|cell| labels::model(&cell.point) == model);
    let series: Vec<Series> = own.map(|cell| series(cell)).collect();
    let most = series.iter().flat_map(|series| &series.points).map(|point| point.y).fold(0.1, f64::max);
    ChartPanel {
        x: Axis::log(format!("time a frame, ms, {model}")),
        y: Axis::percent("frames", most),
        series,
    }
}

/// The outline of the buckets, from 0 to 0.
fn series(cell: &Cell) -> Series {
    let all: u64 = cell.latency_histogram.iter().map(|(_, count)| count).sum();
    let at = |x: f64, y: f64| DataPoint { x, y, ..DataPoint::default() };
    let mut points = Vec::new();
    for (bound, count) in &cell.latency_histogram {
        let share = *count as f64 / all.max(1) as f64;
        let from = bound / BUCKET;
        points.extend([at(from, 0.0), at(from, share), at(*bound, share), at(*bound, 0.0)]);
    }
    Series { name: labels::stream(&cell.point), points, style: SeriesStyle::Line }
}
