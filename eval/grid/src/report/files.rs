//! Writes the report and the charts of a folder of results.

use std::path::{Path, PathBuf};

use modulo_charts::ChartError;

use crate::chart::{self, NamedChart, RenderedChart};
use crate::error::GridError;
use crate::results::RESULTS;
use crate::store::{load, replace};

/// File name of the report.
pub const PAGE: &str = "report.html";
/// Folder of the charts beside the report.
const CHARTS: &str = "charts";
/// First part of the names of charts with images. These charts cannot be drawn from the results.
const PICTURES: &str = "pictures";

/// Draws all charts of the results in `folder` into `folder/charts` and writes [`PAGE`], which also shows the charts with
/// images that are in that folder. Returns the path of the page.
///
/// # Errors
/// [`GridError`] if there are no results, or a file cannot be read or written.
pub fn write(folder: &Path) -> Result<PathBuf, GridError> {
    let found = load(folder)?;
    let results = found.ok_or_else(|| GridError::NoResults(folder.join(RESULTS)))?;
    let mut drawn = Vec::new();
    for named in chart::all(&results) {
        drawn.push(save(&folder.join(CHARTS), &named)?);
    }
    drawn.extend(pictures(&folder.join(CHARTS))?);
    let page = folder.join(PAGE);
    replace(&page, super::page(&results, &drawn).as_bytes())?;
    Ok(page)
}

/// Draws charts with images into `folder/charts`, where [`write`] finds them.
///
/// # Errors
/// [`GridError`] if a chart cannot be drawn or written.
pub fn save_pictures(folder: &Path, pictures: &[NamedChart]) -> Result<(), GridError> {
    pictures.iter().try_for_each(|named| save(&folder.join(CHARTS), named).map(|_| ()))
}

/// Writes `NAME.svg`, `NAME.png`, and for charts with images `NAME.narrow.svg`.
fn save(folder: &Path, named: &NamedChart) -> Result<RenderedChart, GridError> {
    std::fs::create_dir_all(folder).map_err(|why| GridError::io(folder, why))?;
    let chart = |source: ChartError| GridError::Chart(named.name.clone(), source);
    let drawn = named.render().map_err(chart)?;
    let file = |extension: &str| folder.join(format!("{}.{extension}", named.name));
    replace(&file("svg"), drawn.wide.as_bytes())?;
    replace(&file("png"), &named.chart.png().map_err(chart)?)?;
    if named.name.starts_with(PICTURES) {
        replace(&file("narrow.svg"), drawn.narrow.as_bytes())?;
    }
    Ok(drawn)
}

/// The charts with images in the folder, by name.
fn pictures(folder: &Path) -> Result<Vec<RenderedChart>, GridError> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Ok(Vec::new()) };
    let name = |path: PathBuf| Some(path.file_name()?.to_str()?.strip_suffix(".narrow.svg")?.to_owned());
    let mut names: Vec<String> = entries.flatten().filter_map(|entry| name(entry.path())).collect();
    names.sort();
    let read = |path: PathBuf| std::fs::read_to_string(&path).map_err(|why| GridError::io(&path, why));
    let load = |name: String| {
        let wide = read(folder.join(format!("{name}.svg")))?;
        let narrow = read(folder.join(format!("{name}.narrow.svg")))?;
        Ok(RenderedChart { title: name.clone(), name, wide, narrow })
    };
    names.into_iter().map(load).collect()
}
