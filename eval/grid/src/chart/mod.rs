//! The charts of a grid, one file each: from results to a [`Chart`].

mod alpha;
mod frontier;
mod paper;
pub(crate) mod pictures;
mod time;

use modulo_charts::{Chart, ChartBody, ChartError, DataPoint, PageWidth, Series, SeriesStyle};

use crate::labels::{self, Conditions, distinct};
use crate::results::{Cell, Results};
pub use pictures::DetectionPicture;

/// A chart with the name of its files.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedChart {
    /// File name without extension, such as `frontier_alpha4_psf1.4_noise0`.
    pub name: String,
    /// The chart.
    pub chart: Chart,
}

/// A chart as SVG, for a wide and for a narrow page.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderedChart {
    /// Name of the [`NamedChart`].
    pub name: String,
    /// Title of the chart.
    pub title: String,
    /// SVG of [`PageWidth::Wide`].
    pub wide: String,
    /// SVG of [`PageWidth::Narrow`].
    pub narrow: String,
}

impl NamedChart {
    /// A chart whose subtitle names the data and the machine of `results`.
    fn new(name: String, title: String, results: &Results, footer: String, body: ChartBody) -> Self {
        Self { name, chart: Chart { title, subtitle: subtitle(results), footer, body } }
    }

    /// Renders both widths.
    ///
    /// # Errors
    /// [`ChartError`] if a font or picture cannot be processed.
    pub fn render(&self) -> Result<RenderedChart, ChartError> {
        let (wide, narrow) = (self.chart.svg(PageWidth::Wide)?, self.chart.svg(PageWidth::Narrow)?);
        Ok(RenderedChart { name: self.name.clone(), title: self.chart.title.clone(), wide, narrow })
    }
}

/// All charts of the cells of `results`, those of the first conditions first.
pub fn all(results: &Results) -> Vec<NamedChart> {
    let conditions = labels::all_conditions(&results.cells);
    let each = |draw: fn(&Results, Conditions) -> Vec<NamedChart>| {
        conditions.iter().flat_map(|conditions| draw(results, *conditions)).collect::<Vec<_>>()
    };
    [
        each(frontier::charts),
        each(alpha::charts),
        each(paper::charts),
        each(time::stages),
        each(time::histograms),
    ]
    .concat()
}

/// The cells that belong to `conditions`.
fn cells(results: &Results, conditions: Conditions) -> Vec<&Cell> {
    results.cells.iter().filter(|cell| labels::belongs(&cell.point, conditions)).collect()
}

/// The distinct models of cells.
fn models(cells: &[&Cell]) -> Vec<String> {
    distinct(cells.iter().map(|cell| labels::model(&cell.point)))
}

/// The subtitle of a chart: number of frames and objects, engine, machine.
fn subtitle(results: &Results) -> String {
    let objects = results.cells.first().map(|cell| &cell.objects);
    let objects = objects.into_iter().flatten().map(|(group, n)| format!("{n} {group}")).collect::<Vec<_>>();
    let counted = |n: usize, one: &str, many: &str| format!("{n} {}", if n == 1 { one } else { many });
    let devices = distinct(results.cells.iter().map(|cell| {
        let device = &cell.device;
        let threads = counted(device.threads, "thread an inference", "threads an inference");
        let jobs = counted(device.jobs, "frame at a time", "frames at a time");
        format!("{} on {}, {threads}, {jobs}", device.engine, device.processor)
    }));
    let frames = format!("{} labelled frames of {}", results.input.labelled, results.setup.source);
    let objects = format!("objects that count: {}", objects.join(", "));
    [vec![frames, objects], devices].concat().join(" · ")
}

/// Adds a point to the series of a name, which is created if it is missing.
fn add_point(series: &mut Vec<Series>, name: String, point: DataPoint, style: SeriesStyle) {
    match series.iter_mut().find(|series| series.name == name) {
        Some(series) => series.points.push(point),
        None => series.push(Series { name, points: vec![point], style }),
    }
}

/// The conditions as part of a file name.
fn suffix((psf_sigma, noise): Conditions) -> String {
    format!("psf{psf_sigma}_noise{noise}")
}

/// A text as part of a file name.
fn file_name(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() || ".-".contains(c) { c } else { '_' }).collect()
}
