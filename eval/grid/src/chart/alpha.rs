//! Accuracy against the saturation factor of one model: a line for each stream and method.

use modulo_charts::{Axis, ChartBody, ChartPanel, DataPoint, Emphasis, Series, SeriesStyle};

use super::{NamedChart, file_name, models, suffix};
use crate::labels::{self, Conditions, distinct};
use crate::results::{Cell, Results};

/// One chart for each model and input size, if there is more than one alpha.
pub fn charts(results: &Results, conditions: Conditions) -> Vec<NamedChart> {
    let cells = super::cells(results, conditions);
    if distinct(cells.iter().map(|cell| cell.point.alpha)).len() < 2 {
        return Vec::new();
    }
    models(&cells).iter().map(|model| chart(results, &cells, model, conditions)).collect()
}

fn chart(results: &Results, cells: &[&Cell], model: &str, conditions: Conditions) -> NamedChart {
    let of_model = cells.iter().filter(|cell| labels::model(&cell.point) == model);
    let mut cells: Vec<&Cell> = of_model.copied().collect();
    cells.sort_by(|a, b| a.point.alpha.total_cmp(&b.point.alpha));
    let groups = distinct(cells.iter().flat_map(|cell| cell.ap50.keys()));
    let footer = "Alpha: the brightest radiance over what the sensor holds. AP50: average precision at IoU 0.5, \
                  one-to-one matching, ignore regions left out. The sharp ideal is what the scene would look like \
                  without a lens.";
    let title = format!("Accuracy against alpha, {model}, {}", labels::conditions(conditions));
    let body = ChartBody::Panels(groups.iter().map(|group| panel(&cells, group)).collect());
    let name = format!("alpha_{}_{}", file_name(model), suffix(conditions));
    NamedChart::new(name, title, results, footer.to_owned(), body)
}

fn panel(cells: &[&Cell], group: &str) -> ChartPanel {
    let names = distinct(cells.iter().map(|cell| labels::stream(&cell.point)));
    let series = |name: String| {
        let own = cells.iter().filter(|cell| labels::stream(&cell.point) == name);
        let points = own.filter_map(|cell| point(cell, group)).collect();
        Series { name, points, style: SeriesStyle::LineAndMarkers }
    };
    ChartPanel {
        x: Axis::log("alpha, the saturation factor"),
        y: Axis::percent(format!("AP50 of {group}"), 1.0),
        series: names.into_iter().map(series).collect(),
    }
}

fn point(cell: &Cell, group: &str) -> Option<DataPoint> {
    let ap50 = (*cell.ap50.get(group)?)?;
    let interval = cell.interval95.get(&format!("ap50.{group}"));
    let interval = interval.map_or(String::new(), |[low, high]| {
        format!(" (95 % interval {:.1} to {:.1})", 100.0 * low, 100.0 * high)
    });
    let (stream, alpha) = (labels::stream(&cell.point), cell.point.alpha);
    let hover = format!("{stream}, alpha {alpha}: AP50 of {group} {:.1} %{interval}", 100.0 * ap50);
    Some(DataPoint { x: alpha, y: ap50, label: String::new(), hover, emphasis: Emphasis::Normal })
}
