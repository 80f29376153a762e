//! How long frames take: their number over time, a line a stream and method, a panel a model.

use modulo_charts::{Axis, Body, Look, Panel, Point, Series};

use super::{Named, suffix};
use crate::results::{Cell, Results};
use crate::wording::{self, Conditions, distinct};

/// Width of a bucket, as a factor.
const BUCKET: f64 = 1.122_018_454_301_963_3;

/// One, at the alpha nearest to 4.
pub fn charts(results: &Results, conditions: Conditions) -> Vec<Named> {
    let of = |cell: &&Cell| wording::belongs(&cell.point, conditions) && !cell.latency_histogram.is_empty();
    let cells: Vec<&Cell> = wording::nearest_to_four(&results.cells.iter().filter(of).collect::<Vec<_>>());
    let Some(alpha) = cells.first().map(|cell| cell.point.alpha) else { return Vec::new() };
    let models = distinct(cells.iter().map(|cell| wording::model(&cell.point)));
    let footer = "Share of the frames in buckets of 1/20 of a power of ten. From the captured image to the boxes; the \
                 capture and the simulation of the sensor are not in it.";
    let title = format!("How long frames take, alpha {alpha}, {}", wording::conditions(conditions));
    let body = Body::Panels(models.iter().map(|model| panel(&cells, model)).collect());
    let name = format!("histogram_{}", suffix(conditions));
    vec![Named::new(name, title, results, footer.to_owned(), body)]
}

fn panel(cells: &[&Cell], model: &str) -> Panel {
    let own = cells.iter().filter(|cell| wording::model(&cell.point) == model);
    let series: Vec<Series> = own.map(|cell| series(cell)).collect();
    let most = series.iter().flat_map(|series| &series.points).map(|point| point.y).fold(0.1, f64::max);
    Panel { x: Axis::log(format!("time a frame, ms, {model}")), y: Axis::percent("frames", most), series }
}

/// From 0 to 0, level within each bucket.
fn series(cell: &Cell) -> Series {
    let all: u64 = cell.latency_histogram.iter().map(|(_, count)| count).sum();
    let at = |x: f64, y: f64| Point { x, y, ..Point::default() };
    let mut points = Vec::new();
    for (bound, count) in &cell.latency_histogram {
        let share = *count as f64 / all.max(1) as f64;
        let from = bound / BUCKET;
        points.extend([at(from, 0.0), at(from, share), at(*bound, share), at(*bound, 0.0)]);
    }
    Series { name: wording::stream(&cell.point), points, look: Look::Line }
}
