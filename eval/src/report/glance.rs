//! The sum of it: AP50 by stream and alpha, a table for each model and lens.

use super::html::{Td, escape, p, table};
use crate::results::{Cell, Results};
use crate::wording::{self, Conditions, distinct};

/// The tables of the first model and lens are open.
pub fn section(results: &Results) -> String {
    let mut out = String::from("<h2>At a glance</h2>\n");
    out += &p(&format!(
        "AP50 in percent by stream (rows) and alpha (columns), over {} labelled frames; in brackets the 95 % interval \
         of a bootstrap over frames.",
        results.input.labelled
    ));
    let models = distinct(results.cells.iter().map(|cell| wording::model(&cell.point)));
    let all = wording::all_conditions(&results.cells);
    let blocks = models.iter().flat_map(|model| all.iter().map(move |conditions| (model, *conditions)));
    for (index, (model, conditions)) in blocks.enumerate() {
        let tables = tables(results, model, conditions);
        let name = format!("{model}, {}", wording::conditions(conditions));
        let open = if index == 0 { " open=\"open\"" } else { "" };
        out += &format!("<details{open}><summary>{}</summary>\n{tables}</details>\n", escape(&name));
    }
    out
}

/// One for each group.
fn tables(results: &Results, model: &str, conditions: Conditions) -> String {
    let own =
        |cell: &&Cell| wording::model(&cell.point) == model && wording::belongs(&cell.point, conditions);
    let cells: Vec<&Cell> = results.cells.iter().filter(own).collect();
    let table = |group: &String| {
        let objects = cells.first().and_then(|cell| cell.objects.get(group)).unwrap_or(&0);
        format!("<h3>{} ({objects} objects)</h3>\n{}", escape(group), by_alpha(&cells, group))
    };
    distinct(cells.iter().flat_map(|cell| cell.ap50.keys())).into_iter().map(table).collect()
}

fn by_alpha(cells: &[&Cell], group: &str) -> String {
    let mut alphas = distinct(cells.iter().map(|cell| cell.point.alpha));
    alphas.sort_by(f64::total_cmp);
    let head = [vec!["stream".to_owned()], alphas.iter().map(|alpha| format!("alpha {alpha}")).collect()];
    let row = |name: &String| {
        let figure = |alpha: &f64| {
            let found =
                cells.iter().find(|cell| cell.point.alpha == *alpha && wording::stream(&cell.point) == *name);
            found.map_or(Td::number(None, 1), |cell| ap50(cell, group))
        };
        [vec![Td::text(name)], alphas.iter().map(figure).collect()].concat()
    };
    let names = distinct(cells.iter().map(|cell| wording::stream(&cell.point)));
    table(&head.concat(), &names.iter().map(row).collect::<Vec<_>>())
}

fn ap50(cell: &Cell, group: &str) -> Td {
    let value = cell.ap50.get(group).copied().flatten();
    let interval = cell.interval95.get(&format!("ap50.{group}"));
    let interval = interval
        .map(|[low, high]| format!(" ({:.1} to {:.1})", 100.0 * low, 100.0 * high))
        .unwrap_or_default();
    Td::Number(format!("{}{interval}", wording::percent(value)), value)
}
