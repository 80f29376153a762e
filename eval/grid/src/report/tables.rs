//! The tables of the report, whose columns a script can sort: the summary and all cells.

use maud::{Markup, Render, html};
use modulo_runtime::SensorModel;

use crate::labels::{self, GridSetting, STAGES, distinct, number};
use crate::results::{Cell, Results};

/// One cell of a table.
pub enum Td {
    Text(String),
    /// A displayed text and the number by which it is sorted. `None` sorts first.
    Number(String, Option<f64>),
}

impl Td {
    /// A number with `digits` decimal digits; `-` without a value.
    pub fn number(value: Option<f64>, digits: usize) -> Self {
        Self::Number(value.map_or_else(|| "-".to_owned(), |value| number(value, digits)), value)
    }

    /// A setting with all its digits.
    pub fn setting(value: f64) -> Self {
        Self::Number(value.to_string(), Some(value))
    }

    /// A fraction as percent, see [`labels::percent`].
    pub fn percent(fraction: Option<f64>) -> Self {
        Self::Number(labels::percent(fraction), fraction.map(|fraction| 100.0 * fraction))
    }
}

impl Render for Td {
    fn render(&self) -> Markup {
        match self {
            Self::Text(text) => html! { td { (text) } },
            // JavaScript reads another word for an infinite number.
            Self::Number(text, Some(f64::INFINITY)) => html! { td.n data-v="Infinity" { (text) } },
            // The sum with 0 removes the sign of a zero.
            Self::Number(text, Some(value)) => html! { td.n data-v=(value + 0.0) { (text) } },
            // The script compares numbers only: a missing figure gets one that is lower than all others.
            Self::Number(text, None) => html! { td.n data-v="-1e99" { (text) } },
        }
    }
}

/// A table with its head. The head of a column of numbers is above their last digits.
pub fn table(head: &[impl Render], rows: &[Vec<Td>]) -> Markup {
    let is_number =
        |column: usize| rows.first().is_some_and(|row| matches!(row.get(column), Some(Td::Number(..))));
    html! {
        div.wide {
            table.sort {
                thead { tr { @for (column, name) in head.iter().enumerate() { th.n[is_number(column)] scope="col" { (name) } } } }
                tbody { @for row in rows { tr { @for cell in row { (cell) } } } }
            }
        }
    }
}

/// The summary: AP50 by stream and alpha, a table for each model and lens. Those of the first model and lens are open.
pub fn summary(results: &Results) -> Markup {
    let models = distinct(results.cells.iter().map(|cell| labels::model(&cell.point)));
    let all = labels::all_conditions(&results.cells);
    let blocks = models.iter().flat_map(|model| all.iter().map(move |conditions| (model, conditions)));
    html! {
        h2 { "At a glance" }
        p {
            "AP50 in percent by stream (rows) and alpha (columns), over " (results.input.labelled) " labelled frames. "
            "The 95 % interval of the bootstrap is in brackets"
            @if let Some(drawn) = results.input.drawn { "; the bootstrap draws from " (drawn) }
            "."
        }
        @if let Some(warning) = results.input.interval_warning() { p.warning { "Warning: " (warning) "." } }
        @for (index, (model, conditions)) in blocks.enumerate() {
            details open[index == 0] {
                summary { (model) ", " (labels::conditions(conditions)) }
                (group_tables(results, model, conditions))
            }
        }
    }
}

fn group_tables(results: &Results, model: &str, conditions: &SensorModel) -> Markup {
    let own = |cell: &&Cell| labels::model(&cell.point) == model && labels::belongs(&cell.point, conditions);
    let cells: Vec<&Cell> = results.cells.iter().filter(own).collect();
    let objects = |group| cells.first().and_then(|cell| cell.objects.get(group)).unwrap_or(&0);
    html! {
        @for group in distinct(cells.iter().flat_map(|cell| cell.ap50.keys())) {
            h3 { (group) " (" (objects(group)) " " (if *objects(group) == 1 { "object" } else { "objects" }) ")" }
            (by_alpha(&cells, |cell| ap50(cell, group)))
        }
    }
}

fn by_alpha(cells: &[&Cell], figure_of: impl Fn(&Cell) -> Td) -> Markup {
    let alphas = labels::alphas(cells);
    let head = [vec!["stream".to_owned()], alphas.iter().map(|alpha| format!("alpha {alpha}")).collect()];
    let row = |name: &String| {
        let figure = |alpha: &f64| {
            let found = cells
                .iter()
                .find(|cell| cell.point.sensor.alpha == *alpha && labels::stream(&cell.point) == *name);
            found.map_or(Td::number(None, 1), |cell| figure_of(cell))
        };
        std::iter::once(Td::Text(name.clone())).chain(alphas.iter().map(figure)).collect()
    };
    let names = distinct(cells.iter().map(|cell| labels::stream(&cell.point)));
    table(&head.concat(), &names.iter().map(row).collect::<Vec<_>>())
}

fn ap50(cell: &Cell, group: &str) -> Td {
    let value = cell.ap50_of(group);
    let interval = cell.interval_of(group).map(|bounds| format!(" ({})", labels::bounds(bounds)));
    Td::Number(labels::percent(value) + &interval.unwrap_or_default(), value)
}

/// The section with the table of all cells, one row for each.
pub fn cells(results: &Results) -> Markup {
    let groups = distinct(results.cells.iter().flat_map(|cell| cell.ap50.keys().cloned()));
    let timed = |stage: &&str| results.cells.iter().any(|cell| cell.latency_ms.contains_key(*stage));
    let stages: Vec<&str> = STAGES.into_iter().filter(timed).collect();
    let settings = GridSetting::columns(&results.cells);
    let row = |cell: &Cell| cell_row(cell, (&settings, &groups, &stages)).into_iter().unzip();
    // Without a cell, the head is there all the same.
    let (head, _): (Vec<String>, Vec<Td>) = row(results.cells.first().unwrap_or(&Cell::default()));
    let rows: Vec<Vec<Td>> = results.cells.iter().map(|cell| row(cell).1).collect();
    html! {
        h2 { "All cells" }
        p {
            "Figures are in percent unless a unit is named. Exact samples have the true wrap count, wholly exact frames have no "
            "other ones, and a trusted frame is wrong if less than 99.9 % of its samples are exact. Click on the name of a column to sort by it. These and more "
            "figures are in results.json beside this page, and the boxes of each frame in the folder cells."
        }
        (table(&head, &rows))
    }
}

/// The columns of a cell with their names: settings, figures, `groups` and `stages`.
fn cell_row(
    cell: &Cell,
    (settings, groups, stages): (&[GridSetting], &[String], &[&str]),
) -> Vec<(String, Td)> {
    let point = &cell.point;
    let of = |name: &str, td| (name.to_owned(), td);
    let mut row = vec![of("stream", Td::Text(labels::stream(point)))];
    row.extend(settings.iter().map(|setting| (setting.column(), Td::setting(setting.of(point)))));
    row.extend([
        of("model", Td::Text(point.model.clone())),
        of("input", Td::Text(point.input.clone())),
        of("frames", Td::Number(frames(cell), Some(cell.frames as f64))),
    ]);
    row.extend(groups.iter().map(|group| (format!("AP50 {group}"), Td::percent(cell.ap50_of(group)))));
    row.extend([
        of("AP50:95", Td::percent(cell.ap50_95)),
        of("exact samples", Td::percent(cell.exact_k)),
        of("wholly exact frames", Td::percent(cell.exact_frames)),
        of("trusted frames", Td::percent(cell.trusted)),
        of("trusted but wrong frames", Td::number(cell.trusted_wrong.map(|count| count as f64), 0)),
        of("PSNR dB", Td::number(cell.psnr_db, 2)),
        of("SSIM", Td::number(cell.ssim, 4)),
        of("ms a frame", time(cell)),
        of("CPU ms", Td::number(cell.frame_ms.as_ref().map(|time| time.cpu_ms), 1)),
    ]);
    let stage = |stage: &&str| {
        let time = cell.latency_ms.get(*stage);
        let text = time.map(|time| [time.p50, time.p95, time.p99].map(|ms| number(ms, 1)).join(" / "));
        let shown = Td::Number(text.unwrap_or_else(|| "-".to_owned()), time.map(|time| time.p50));
        (format!("{stage} ms p50 / p95 / p99"), shown)
    };
    row.extend(stages.iter().map(stage));
    row
}

/// The time of a frame with its interval.
fn time(cell: &Cell) -> Td {
    let Some(time) = &cell.frame_ms else { return Td::number(None, 1) };
    let [p50, low, high] = [time.p50, time.interval95[0], time.interval95[1]].map(|ms| number(ms, 1));
    Td::Number(format!("{p50} ({low} to {high})"), Some(time.p50))
}

fn frames(cell: &Cell) -> String {
    match cell.unanswered {
        0 => cell.frames.to_string(),
        missing => format!("{}, {missing} unanswered", cell.frames),
    }
}
