//! Accuracy against the saturation factor: a line a stream and method, for one model.

use modulo_charts::{Axis, Body, Look, Panel, Point, Series, Tone};

use super::{Named, file_name, suffix};
use crate::results::{Cell, Results};
use crate::wording::{self, Conditions, distinct};

/// One for each model and input size, where there is more than one alpha.
pub fn charts(results: &Results, conditions: Conditions) -> Vec<Named> {
    let cells: Vec<&Cell> =
        results.cells.iter().filter(|cell| wording::belongs(&cell.point, conditions)).collect();
    if distinct(cells.iter().map(|cell| cell.point.alpha)).len() < 2 {
        return Vec::new();
    }
    let models = distinct(cells.iter().map(|cell| wording::model(&cell.point)));
    models.iter().map(|model| chart(results, &cells, model, conditions)).collect()
}

fn chart(results: &Results, cells: &[&Cell], model: &str, conditions: Conditions) -> Named {
    let of_model = cells.iter().filter(|cell| wording::model(&cell.point) == model);
    let mut cells: Vec<&Cell> = of_model.copied().collect();
    cells.sort_by(|a, b| a.point.alpha.total_cmp(&b.point.alpha));
    let groups = distinct(cells.iter().flat_map(|cell| cell.ap50.keys()));
    let footer = "Alpha: the brightest radiance over what the sensor holds. AP50: average precision at IoU 0.5, \
                  one-to-one matching, ignore regions left out. The sharp ideal is what the scene would look like \
                  without a lens.";
    let title = format!("Accuracy against alpha, {model}, {}", wording::conditions(conditions));
    let body = Body::Panels(groups.iter().map(|group| panel(&cells, group)).collect());
    let name = format!("alpha_{}_{}", file_name(model), suffix(conditions));
    Named::new(name, title, results, footer.to_owned(), body)
}

fn panel(cells: &[&Cell], group: &str) -> Panel {
    let names = distinct(cells.iter().map(|cell| wording::stream(&cell.point)));
    let series = |name: String| {
        let own = cells.iter().filter(|cell| wording::stream(&cell.point) == name);
        let points = own.filter_map(|cell| point(cell, group)).collect();
        Series { name, points, look: Look::Joined }
    };
    Panel {
        x: Axis::log("alpha, the saturation factor"),
        y: Axis::percent(format!("AP50 of {group}"), 1.0),
        series: names.into_iter().map(series).collect(),
    }
}

fn point(cell: &Cell, group: &str) -> Option<Point> {
    let ap50 = (*cell.ap50.get(group)?)?;
    let interval = cell.interval95.get(&format!("ap50.{group}"));
    let interval = interval.map_or(String::new(), |[low, high]| {
        format!(" (95 % interval {:.1} to {:.1})", 100.0 * low, 100.0 * high)
    });
    let (stream, alpha) = (wording::stream(&cell.point), cell.point.alpha);
    let hover = format!("{stream}, alpha {alpha}: AP50 of {group} {:.1} %{interval}", 100.0 * ap50);
    Some(Point { x: alpha, y: ap50, label: String::new(), hover, tone: Tone::Full })
}
