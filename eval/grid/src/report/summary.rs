//! The summary: AP50 by stream and alpha, a table for each model and lens.

use maud::{Markup, html};

use super::table::{Td, table};
use crate::labels::{self, Conditions, distinct};
use crate::results::{Cell, Results};

/// The section with the tables. Those of the first model and lens are open.
pub fn section(results: &Results) -> Markup {
    let models = distinct(results.cells.iter().map(|cell| labels::model(&cell.point)));
    let all = labels::all_conditions(&results.cells);
    let blocks = models.iter().flat_map(|model| all.iter().map(move |conditions| (model, *conditions)));
    html! {
        h2 { "At a glance" }
        p {
            "AP50 in percent by stream (rows) and alpha (columns), over " (results.input.labelled) " labelled frames. "
            "The 95 % interval of the bootstrap is in brackets."
        }
        @for (index, (model, conditions)) in blocks.enumerate() {
            details open[index == 0] {
                summary { (model) ", " (labels::conditions(conditions)) }
                (tables(results, model, conditions))
            }
        }
    }
}

/// The tables of one model and lens, one for each group.
fn tables(results: &Results, model: &str, conditions: Conditions) -> Markup {
    let own = |cell: &&Cell| labels::model(&cell.point) == model && labels::belongs(&cell.point, conditions);
    let cells: Vec<&Cell> = results.cells.iter().filter(own).collect();
    let objects = |group| cells.first().and_then(|cell| cell.objects.get(group)).unwrap_or(&0);
    html! {
        @for group in distinct(cells.iter().flat_map(|cell| cell.ap50.keys())) {
            h3 { (group) " (" (objects(group)) " objects)" }
            (by_alpha(&cells, group))
        }
    }
}

fn by_alpha(cells: &[&Cell], group: &str) -> Markup {
    let mut alphas = distinct(cells.iter().map(|cell| cell.point.alpha));
    alphas.sort_by(f64::total_cmp);
    let head = [vec!["stream".to_owned()], alphas.iter().map(|alpha| format!("alpha {alpha}")).collect()];
    let row = |name: &String| {
        let figure = |alpha: &f64| {
            let found =
                cells.iter().find(|cell| cell.point.alpha == *alpha && labels::stream(&cell.point) == *name);
            found.map_or(Td::number(None, 1), |cell| ap50(cell, group))
        };
        std::iter::once(Td::Text(name.clone())).chain(alphas.iter().map(figure)).collect()
    };
    let names = distinct(cells.iter().map(|cell| labels::stream(&cell.point)));
    table(&head.concat(), &names.iter().map(row).collect::<Vec<_>>())
}

fn ap50(cell: &Cell, group: &str) -> Td {
    let value = cell.ap50.get(group).copied().flatten();
    let interval = cell.interval95.get(&format!("ap50.{group}"));
    let interval = interval.map(|[low, high]| format!(" ({:.1} to {:.1})", 100.0 * low, 100.0 * high));
    let text = labels::percent(value) + interval.as_deref().unwrap_or("");
    Td::Number(text, value)
}
