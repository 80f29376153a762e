//! `index.html`: one page for screen, phone and paper, without script or network.

use std::collections::BTreeMap;

use maud::{Markup, PreEscaped, html};
use modulo_draw::{below_100, html_page, number};

use super::{FieldCell, FieldResults, mean, methods};

/// Heads of the columns of figures, in the order of [`Figures::texts`].
const HEADS: [&str; 9] = [
    "exact k, %",
    "exact up to offsets, %",
    "PSNR, dB",
    "SSIM",
    "trusted, %",
    "trusted and wrong",
    "ms",
    "processor ms",
    "without a result",
];

/// The page of `results`, with a wide and a narrow SVG of each chart.
pub fn html(
    results: &FieldResults,
    definitions: &BTreeMap<String, String>,
    charts: &[[String; 2]],
) -> String {
    let title = "Unwrapping methods on the same frames and sensors";
    let detected = results.cells.iter().any(|cell| !cell.ap50.is_empty());
    let of_method = |method: &String| -> Vec<&FieldCell> {
        results.cells.iter().filter(|cell| cell.method == *method).collect()
    };
    let with_figures = |method: String| (method.clone(), Figures::of(&of_method(&method)));
    let summary: Vec<_> = methods(results.cells.iter()).into_iter().map(with_figures).collect();
    let body = html! {
        h1 { (title) }
        @for fact in &results.facts { p { (fact) } }
        h2 { "At a glance" }
        p.note { "Means over all sensors; the best figure of each column is bold." }
        (table("method", &summary, detected))
        (failures(results))
        h2 { "Charts" }
        @for [wide, narrow] in charts {
            figure { div.broad { (PreEscaped(wide)) } div.narrow { (PreEscaped(narrow)) } }
        }
        h2 { "Each sensor" }
        @for sensor in modulo_draw::distinct(results.cells.iter().map(|cell| cell.sensor_name.clone())) {
            details {
                summary { (sensor) }
                @let own = results.cells.iter().filter(|cell| cell.sensor_name == sensor);
                (table("method", &own.map(|cell| (cell.method.clone(), Figures::of(&[cell]))).collect::<Vec<_>>(), detected))
            }
        }
        h2 { "Definitions" }
        dl { @for (name, text) in definitions { dt { (name) } dd { (text) } } }
    };
    html_page(title, include_str!("page.css"), body)
}

/// The figures of a row; `None` without a value.
struct Figures {
    values: [Option<f64>; 9],
    ap50: Option<f64>,
}

impl Figures {
    /// The means over `cells`, and the sums of what is counted.
    fn of(cells: &[&FieldCell]) -> Self {
        let over = |value: fn(&FieldCell) -> Option<f64>| {
            let mean = mean(cells.iter().filter_map(|cell| value(cell)));
            mean.is_finite().then_some(mean)
        };
        let count = |value: fn(&FieldCell) -> Option<f64>| {
            let values: Vec<f64> = cells.iter().filter_map(|cell| value(cell)).collect();
            (!values.is_empty()).then(|| values.iter().sum())
        };
        let ap50 = |cell: &FieldCell| {
            let mean = mean(cell.ap50.values().flatten().copied());
            mean.is_finite().then_some(mean)
        };
        let values = [
            over(|cell| Some(cell.exact_k)),
            over(|cell| Some(cell.up_to_offset)),
            over(|cell| cell.psnr_db),
            over(|cell| cell.ssim),
            over(|cell| cell.trusted),
            count(|cell| cell.trusted_wrong.map(|n| n as f64)),
            over(|cell| cell.frame_ms.map(|time| time.p50)),
            over(|cell| cell.frame_ms.map(|time| time.cpu_ms)),
            count(|cell| Some(cell.failures.values().sum::<usize>() as f64)),
        ];
        Self { values, ap50: over(ap50) }
    }

    fn texts(&self) -> [String; 9] {
        let forms: [fn(f64) -> String; 9] = [
            |v| below_100(v, 2),
            |v| below_100(v, 2),
            |v| number(v, 1),
            |v| number(v, 3),
            |v| below_100(v, 0),
            |v| number(v, 0),
            |v| number(v, 1),
            |v| number(v, 1),
            |v| number(v, 0),
        ];
        std::array::from_fn(|i| self.values[i].map_or_else(|| "-".to_owned(), forms[i]))
    }
}

/// A table of figures with AP50 if boxes were detected.
fn table(first: &str, rows: &[(String, Figures)], detected: bool) -> Markup {
    // Up to the SSIM more is better, then there are counts and shares without a best, and times of which less is better.
    let best = |column: usize| {
        let values = rows.iter().filter_map(|(_, figures)| figures.values[column]);
        match column {
            0..=3 => values.max_by(f64::total_cmp),
            6 | 7 => values.min_by(f64::total_cmp),
            _ => None,
        }
    };
    html! {
        div.wide {
            table {
                thead { tr { th { (first) } @for head in HEADS { th.n { (head) } } @if detected { th.n { "AP50, %" } } } }
                tbody {
                    @for (name, figures) in rows {
                        tr {
                            td { (name) }
                            @for (column, text) in figures.texts().iter().enumerate() {
                                td.n.best[rows.len() > 1 && figures.values[column].is_some() && figures.values[column] == best(column)] { (text) }
                            }
                            @if detected { td.n { (figures.ap50.map_or_else(|| "-".to_owned(), |ap| below_100(ap, 1))) } }
                        }
                    }
                }
            }
        }
    }
}

/// The reasons for which frames have no result, with their number.
fn failures(results: &FieldResults) -> Markup {
    let mut counts: BTreeMap<(&str, &str), usize> = BTreeMap::new();
    for cell in &results.cells {
        for (why, frames) in &cell.failures {
            *counts.entry((&cell.method, why)).or_default() += frames;
        }
    }
    html! {
        @if !counts.is_empty() {
            h3 { "Without a result" }
            @for ((method, why), frames) in &counts {
                p.failed { b { (method) } " " (why) " (" (frames) @if *frames == 1 { " frame" } @else { " frames" } ")" }
            }
        }
    }
}
