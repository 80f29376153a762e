//! The report: one HTML page that needs no network, and the charts beside it. The script of the page only sorts tables.

pub(crate) mod tables;

use std::path::{Path, PathBuf};

use maud::{Markup, PreEscaped, html};
use modulo_draw::{ChartError, html_page};

use crate::GridError;
use crate::chart::pictures::PICTURES;
use crate::chart::{self, NamedChart, RenderedChart};
use crate::labels;
use crate::results::Results;
use crate::store::replace;

/// The whole page with `charts` in their order.
pub fn page(results: &Results, charts: &[RenderedChart]) -> String {
    let (done, all) = (results.cells.len(), results.setup.grid.len());
    let title = format!("modulo eval: {}", results.setup.source);
    let body = html! {
        @if done < all {
            p.warning { (done) " of " (all) " cells are here: this is a part of the grid, or a run that was ended." }
        }
        @for warning in labels::busy(&results.cells) { p.warning { (warning) } }
        @if let Some(verdict) = &results.verdict { p { strong { (verdict) "." } } }
        @for chart in charts.iter().filter(|chart| chart.name == PICTURES) { (figure(chart)) }
        (tables::summary(results))
        (figures(charts))
        (tables::cells(results))
        (setup(results))
    };
    html(&title, body)
}

/// A page with the style of all reports, whose tables can be sorted.
pub(crate) fn html(title: &str, body: Markup) -> String {
    let body = html! { h1 { (title) } (body) script { (PreEscaped(include_str!("sort.js"))) } };
    html_page(title, include_str!("style.css"), body)
}

/// All charts. The first one of each kind is open.
fn figures(charts: &[RenderedChart]) -> Markup {
    // The kind is the part of the name before the first `_`.
    let kind = |chart: &RenderedChart| chart.name.split('_').next().map(str::to_owned);
    let charts: Vec<&RenderedChart> = charts.iter().filter(|chart| chart.name != PICTURES).collect();
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
    let facts = [
        ("modulo", setup.version.clone()),
        ("source", setup.source.clone()),
        ("frames", format!("{}, {} of them labelled, {} drives", input.frames, input.labelled, input.drives)),
        ("digest of frames and labels", format!("sha256 {}", input.digest)),
        ("difficulty", format!("{:?}", setup.difficulty).to_lowercase()),
        ("measured with", labels::devices(&results.cells).join("; ")),
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

/// File name of the report.
pub const PAGE: &str = "report.html";
/// Folder of the charts beside the report.
const CHARTS: &str = "charts";
/// The picture of the frame in which the streams differ most, beside the report.
pub const GRID: &str = "grid.png";

/// Draws all charts of `results` into `folder/charts` and writes [`PAGE`] into `folder`, which also shows the chart with
/// images that is in that folder. Returns the path of the page.
///
/// # Errors
/// [`GridError`] if a chart cannot be drawn, or a file cannot be read or written.
pub fn write(folder: &Path, results: &Results) -> Result<PathBuf, GridError> {
    let (path, charts) = (folder.join(PAGE), folder.join(CHARTS));
    let drawn: Result<Vec<_>, _> = chart::all(results).iter().map(|named| save(&charts, named)).collect();
    let charts: Vec<RenderedChart> = drawn?.into_iter().chain(pictures(&charts)?).collect();
    replace(&path, page(results, &charts).as_bytes())?;
    Ok(path)
}

/// Draws the chart with images into `folder/charts`, where [`write()`] finds it.
///
/// # Errors
/// [`GridError`] if it cannot be drawn or written.
pub fn save_pictures(folder: &Path, pictures: &NamedChart) -> Result<(), GridError> {
    save(&folder.join(CHARTS), pictures).map(drop)
}

/// Writes `NAME.svg`, `NAME.png`, and for the chart with images `NAME.narrow.svg`.
fn save(folder: &Path, named: &NamedChart) -> Result<RenderedChart, GridError> {
    let chart = |why: ChartError| GridError::Results(format!("chart {}: {why}", named.name));
    let drawn = named.render().map_err(chart)?;
    let file = |extension: &str| folder.join(format!("{}.{extension}", named.name));
    replace(&file("svg"), drawn.wide.as_bytes())?;
    // The narrow form of pictures is kept for the next report.
    let (png, narrow) = match named.name == PICTURES {
        true => (folder.with_file_name(GRID), Some(file("narrow.svg"))),
        false => (file("png"), None),
    };
    narrow.map_or(Ok(()), |narrow| replace(&narrow, drawn.narrow.as_bytes()))?;
    replace(&png, &named.chart.png().map_err(chart)?)?;
    Ok(drawn)
}

/// The chart with images in the folder; `None` where there is none.
fn pictures(folder: &Path) -> Result<Option<RenderedChart>, GridError> {
    let path = |ending: &str| folder.join(format!("{PICTURES}.{ending}"));
    if !path("narrow.svg").exists() {
        return Ok(None);
    }
    let read = |path: PathBuf| std::fs::read_to_string(&path).map_err(|why| GridError::io(&path, why));
    Ok(Some(RenderedChart {
        title: "What the detector sees".to_owned(),
        name: PICTURES.to_owned(),
        wide: read(path("svg"))?,
        narrow: read(path("narrow.svg"))?,
    }))
}
