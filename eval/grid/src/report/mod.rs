//! The report: one HTML page that needs no network. Its script only sorts tables.

mod cells;
mod files;
mod paper;
mod summary;
mod table;

use maud::{Markup, PreEscaped, html};
use modulo_charts::html_page;

use crate::chart::RenderedChart;
use crate::labels::distinct;
use crate::results::Results;
pub use files::{PAGE, save_pictures, write};

/// The whole page with `charts` in their order.
pub fn page(results: &Results, charts: &[RenderedChart]) -> String {
    let (done, all) = (results.cells.len(), results.setup.grid.len());
    let title = format!("modulo eval: {}", results.setup.source);
    let body = html! {
        h1 { (title) }
        @if done < all {
            p.warning { (done) " of " (all) " cells are here: this is a part of the grid, or a run that was ended." }
        }
        (summary::section(results))
        (figures(charts))
        (paper::section(results))
        (cells::section(results))
        (setup(results))
        script { (PreEscaped(include_str!("sort.js"))) }
    };
    html_page(&title, include_str!("style.css"), body)
}

/// All charts. The first one of each kind is open.
fn figures(charts: &[RenderedChart]) -> Markup {
    // The kind is the part of the name before the first `_`.
    let kind = |chart: &RenderedChart| chart.name.split('_').next().map(str::to_owned);
    html! {
        h2 { "Charts" }
        p.note { "Move the pointer to a marker to see its cell." }
        @for (index, chart) in charts.iter().enumerate() {
            @if charts[..index].iter().all(|other| kind(other) != kind(chart)) { (figure(chart)) }
            @else { details { summary { (chart.title) } (figure(chart)) } }
        }
    }
}

/// A chart for wide and for narrow pages. The style sheet shows one of them.
fn figure(RenderedChart { name, wide, narrow, .. }: &RenderedChart) -> Markup {
    html! { figure id=(name) { div.broad { (PreEscaped(wide)) } div.narrow { (PreEscaped(narrow)) } } }
}

/// The definitions of the figures, and the data and settings of the grid.
fn setup(results: &Results) -> Markup {
    let (setup, input) = (&results.setup, &results.input);
    let pairs = |map: &std::collections::BTreeMap<String, String>| {
        map.iter().map(|(from, to)| format!("{from} -> {to}")).collect::<Vec<_>>().join(", ")
    };
    let unmapped =
        input.without_twin.iter().map(|(whose, classes)| format!("{whose}: {}", classes.join(", ")));
    let devices = distinct(results.cells.iter().map(|cell| {
        let device = &cell.device;
        format!("{} on {}, {} threads, {} jobs", device.engine, device.processor, device.threads, device.jobs)
    }));
    let facts = [
        ("modulo", setup.version.clone()),
        ("source", setup.source.clone()),
        ("frames", format!("{}, {} of them labelled, {} drives", input.frames, input.labelled, input.drives)),
        ("digest of frames and labels", format!("sha256 {}", input.digest)),
        ("protocol", format!("{:?}", setup.protocol).to_lowercase()),
        ("sensor", format!("{} bits, seed {}", setup.bits, setup.seed)),
        ("difficulty", format!("{:?}", setup.difficulty).to_lowercase()),
        ("requested engine", setup.engine.clone()),
        ("measured with", devices.join("; ")),
        ("models", pairs(&setup.models)),
        ("classes of the model to those of the labels", pairs(&setup.class_map)),
        ("classes of the labels to groups", pairs(&setup.groups)),
        ("classes without a counterpart", unmapped.collect::<Vec<_>>().join("; ")),
    ];
    html! {
        h2 { "Definitions" }
        dl { @for (name, text) in &results.definitions { dt { (name) } dd { (text) } } }
        h2 { "Configuration" }
        @for warning in &input.warnings { p { (warning) } }
        dl { @for (name, text) in &facts { dt { (name) } dd { @if text.is_empty() { "-" } @else { (text) } } } }
    }
}
