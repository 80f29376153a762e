//! The charts of a grid: from results to a [`Chart`]. This file has the charts over alpha.

pub(crate) mod pictures;
mod time;

use modulo_charts::{
    Axis, Chart, ChartBody, ChartError, ChartPanel, DataPoint, Emphasis, PageWidth, Series, SeriesStyle,
};

use crate::labels::{self, Conditions, distinct};
use crate::published;
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
    pub(crate) fn new(
        name: String,
        title: String,
        results: &Results,
        footer: String,
        body: ChartBody,
    ) -> Self {
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
    [each(time::frontiers), each(alphas), each(published::charts), each(time::stages), each(time::histograms)]
        .concat()
}

/// The cells that belong to `conditions`.
pub(crate) fn cells(results: &Results, conditions: Conditions) -> Vec<&Cell> {
    results.cells.iter().filter(|cell| labels::belongs(&cell.point, conditions)).collect()
}

/// The distinct models of cells.
pub(crate) fn models(cells: &[&Cell]) -> Vec<String> {
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
        format!("{} on {}, {threads}", device.engine, device.processor)
    }));
    let busy = if labels::busy(&results.cells).is_empty() { vec![] } else { vec!["BUSY MACHINE".to_owned()] };
    let frames = format!("{} labelled frames of {}", results.input.labelled, results.setup.source);
    let objects = format!("objects that count: {}", objects.join(", "));
    [vec![frames, objects], devices, busy].concat().join(" · ")
}

/// Adds a point to the series of a name, which is created if it is missing.
pub(crate) fn add_point(series: &mut Vec<Series>, name: String, point: DataPoint, style: SeriesStyle) {
    match series.iter_mut().find(|series| series.name == name) {
        Some(series) => series.points.push(point),
        None => series.push(Series { name, points: vec![point], style }),
    }
}

/// The conditions as part of a file name.
pub(crate) fn suffix((psf_sigma, noise): Conditions) -> String {
    format!("psf{psf_sigma}_noise{noise}")
}

/// A text as part of a file name.
pub(crate) fn file_name(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() || ".-".contains(c) { c } else { '_' }).collect()
}

/// Accuracy against the saturation factor: one chart for each model and input size, with a line for each stream and method.
/// There is no chart of a single alpha.
fn alphas(results: &Results, conditions: Conditions) -> Vec<NamedChart> {
    let cells = cells(results, conditions);
    if distinct(cells.iter().map(|cell| cell.point.alpha)).len() < 2 {
        return Vec::new();
    }
    models(&cells).iter().map(|model| over_alpha(results, &cells, model, conditions)).collect()
}

fn over_alpha(results: &Results, cells: &[&Cell], model: &str, conditions: Conditions) -> NamedChart {
    let of_model = cells.iter().filter(|cell| labels::model(&cell.point) == model);
    let mut cells: Vec<&Cell> = of_model.copied().collect();
    // The line joins its points in this order. The cells have the order of the grid, in which alpha is as the user gave
    // it.
    cells.sort_by(|a, b| a.point.alpha.total_cmp(&b.point.alpha));
    // A panel for each group: in one panel, the series of two groups would have the same names.
    let groups = distinct(cells.iter().flat_map(|cell| cell.ap50.keys()));
    let footer = "Alpha: the brightest radiance over what the sensor holds. AP50: average precision at IoU 0.5, \
                  one-to-one matching, ignore regions left out. The sharp ideal is what the scene would look like \
                  without a lens.";
    let title = format!("Accuracy against alpha, {model}, {}", labels::conditions(conditions));
    let body = ChartBody::Panels(groups.iter().map(|group| panel(&cells, group)).collect());
    let name = format!("alpha_{}_{}", file_name(model), suffix(conditions));
    NamedChart::new(name, title, results, footer.to_owned(), body)
}

fn panel(cells: &[&Cell], group: &str) -> ChartPanel {
    let names = distinct(cells.iter().map(|cell| labels::stream(&cell.point)));
    let series = |name: String| {
        let own = cells.iter().filter(|cell| labels::stream(&cell.point) == name);
        let points = own.filter_map(|cell| point(cell, group)).collect();
        Series { name, points, style: SeriesStyle::LineAndMarkers }
    };
    ChartPanel {
        x: Axis::log("alpha, the saturation factor"),
        y: Axis::percent(format!("AP50 of {group}"), 1.0),
        series: names.into_iter().map(series).collect(),
    }
}

fn point(cell: &Cell, group: &str) -> Option<DataPoint> {
    let ap50 = (*cell.ap50.get(group)?)?;
    let interval = cell.interval95.get(&format!("ap50.{group}"));
    let interval = interval.map_or(String::new(), |[low, high]| {
        format!(" (95 % interval {:.1} to {:.1})", 100.0 * low, 100.0 * high)
    });
    let (stream, alpha) = (labels::stream(&cell.point), cell.point.alpha);
    let hover = format!("{stream}, alpha {alpha}: AP50 of {group} {:.1} %{interval}", 100.0 * ap50);
    Some(DataPoint { x: alpha, y: ap50, label: String::new(), hover, emphasis: Emphasis::Normal })
}
