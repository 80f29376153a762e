//! The report: one HTML page that needs no network, and the charts beside it. The script of the page only sorts tables.

pub(crate) mod tables;

use std::path::{Path, PathBuf};

use maud::{Markup, PreEscaped, html};
use modulo_draw::{PageWidth, RgbImage, html_page};
use modulo_images::read_image;

use crate::GridError;
use crate::chart::{self, NamedChart};
use crate::labels;
use crate::recordings::picture;
use crate::results::Results;
use crate::store::replace;

/// The whole page with `charts` in their order, and with the image of this address.
pub fn page(results: &Results, charts: &[NamedChart], picture: Option<&str>) -> String {
    let (done, all) = (results.cells.len(), results.setup.grid.len());
    let title = format!("modulo eval: {}", results.setup.source);
    let body = html! {
        h1 { (title) }
        @if done < all {
            p.warning { (done) " of " (all) " cells are here: this is a part of the grid, or a run that was ended." }
        }
        @for warning in labels::busy(&results.cells) { p.warning { (warning) } }
        @if let Some(verdict) = &results.verdict { p { strong { (verdict) "." } } }
        @if let Some(picture) = picture {
            figure {
                div.wide tabindex="0" { img src=(picture) alt="The frame in which the streams differ most."; }
                figcaption.note { (ABOUT_PICTURES) }
            }
        }
        (tables::summary(results))
        @if !charts.is_empty() { (figures(charts)) }
        (tables::cells(results))
        (setup(results))
        script { (PreEscaped(include_str!("sort.js"))) }
    };
    html_page(&title, include_str!("style.css"), body)
}

/// All charts. The first one of each kind is open.
fn figures(charts: &[NamedChart]) -> Markup {
    // The kind is the part of the name before the first `_`.
    let kind = |chart: &NamedChart| chart.name.split('_').next().map(str::to_owned);
    html! {
        h2 { "Charts" }
        p.note { "Point at a marker, or touch it, to see its cell." }
        @for (index, chart) in charts.iter().enumerate() {
            @if charts[..index].iter().all(|other| kind(other) != kind(chart)) { (figure(chart)) }
            @else { details { summary { (chart.chart.title) } (figure(chart)) } }
        }
    }
}

/// A chart for wide and for narrow pages. The style sheet shows one of them.
fn figure(NamedChart { name, chart }: &NamedChart) -> Markup {
    let [wide, narrow] = [PageWidth::Wide, PageWidth::Narrow].map(|page| chart.svg(page));
    html! { figure id=(name) { div.broad { (PreEscaped(wide)) } div.narrow { (PreEscaped(narrow)) } } }
}

/// The definitions of the figures, and the data and settings of the grid.
fn setup(results: &Results) -> Markup {
    let (setup, input) = (&results.setup, &results.input);
    let pairs = |map: &std::collections::BTreeMap<String, String>| {
        map.iter().map(|(from, to)| format!("{from} -> {to}")).collect::<Vec<_>>().join(", ")
    };
    let unmapped = input.without_twin.iter().filter(|(_, classes)| !classes.is_empty());
    let unmapped = unmapped.map(|(whose, classes)| format!("{whose}: {}", classes.join(", ")));
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
        dl { @for (name, text) in facts.iter().filter(|(_, text)| !text.is_empty()) { dt { (name) } dd { (text) } } }
    }
}

/// File name of the report.
pub const PAGE: &str = "report.html";
/// Folder of the charts beside the report.
const CHARTS: &str = "charts";
/// The picture of the frame in which the streams differ most, beside the report.
pub const GRID: &str = "grid.png";

/// Says what the colours of the boxes mean.
const ABOUT_PICTURES: &str = "The frame in which the streams differ most in the objects that are found. White boxes are labelled objects. Coloured boxes \
                              are objects that were found with at least the score_threshold of their detector, 0.25 by default, in the \
                              colour of their class.";

/// Draws all charts of `results` into `folder/charts` and writes [`PAGE`] into `folder`, which also shows the pictures that
/// are in that folder. Returns the path of the page.
///
/// # Errors
/// [`GridError`] if a file cannot be read or written.
pub fn write(folder: &Path, results: &Results) -> Result<PathBuf, GridError> {
    let charts = chart::all(results);
    for NamedChart { name, chart } in &charts {
        let svg = chart.svg(PageWidth::Wide);
        replace(&folder.join(CHARTS).join(format!("{name}.svg")), svg.as_bytes())?;
    }
    let (path, pictures) = (folder.join(PAGE), embedded(&folder.join(GRID))?);
    replace(&path, page(results, &charts, pictures.as_deref()).as_bytes())?;
    Ok(path)
}

/// Writes pictures into `folder`, where [`write()`] finds them.
pub(crate) fn save_pictures(folder: &Path, pictures: &RgbImage) -> Result<(), GridError> {
    let path = folder.join(GRID);
    // Another process on this folder may read it at any time.
    let unfinished = folder.join(format!("{}.{GRID}", std::process::id()));
    pictures.save(&unfinished).map_err(|why| GridError::of_file(&unfinished, why))?;
    std::fs::rename(&unfinished, &path).map_err(|why| GridError::io(&path, why))
}

/// The address of an image for the page; `None` where there is none.
fn embedded(path: &Path) -> Result<Option<String>, GridError> {
    if !path.exists() {
        return Ok(None);
    }
    let picture = picture(&read_image(path)?).map(|picture| picture.embedded()).transpose();
    picture.map_err(|why| GridError::Results(format!("{}: {why}", path.display())))
}
