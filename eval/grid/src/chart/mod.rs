//! The charts of a grid: from results to a [`Chart`]. This file has the charts over a setting of the sensor.

mod frontier;
mod pareto;

use modulo_draw::{Axis, Chart, ChartPanel, DataPoint, Scale, Series, SeriesStyle};
use modulo_runtime::SensorModel;

use crate::labels::{self, GridSetting, distinct, number};
use crate::results::{Cell, Results, file_name};

/// A chart with the name of its files.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedChart {
    /// File name without extension, such as `frontier_alpha4_psf1.4_read0`.
    pub name: String,
    /// The chart.
    pub chart: Chart,
}

impl NamedChart {
    /// A chart whose subtitle names the data and the machine of `results`.
    pub(crate) fn new(
        name: String,
        title: String,
        results: &Results,
        footer: &str,
        panels: Vec<ChartPanel>,
    ) -> Self {
        let (subtitle, footer) = (subtitle(results), footer.to_owned());
        Self { name, chart: Chart { title, subtitle, footer, panels } }
    }
}

/// All charts of the cells of `results`, those of the first conditions first.
pub fn all(results: &Results) -> Vec<NamedChart> {
    let conditions = labels::all_conditions(&results.cells);
    let frontiers = conditions.iter().flat_map(|conditions| frontier::charts(results, conditions));
    let over = GridSetting::all().flat_map(|setting| over(results, setting));
    frontiers.chain(over).collect()
}

pub(crate) fn models(cells: &[&Cell]) -> Vec<String> {
    distinct(cells.iter().map(|cell| labels::model(&cell.point)))
}

/// The subtitle of a chart: number of frames and objects, engine, machine.
fn subtitle(results: &Results) -> String {
    let objects = results.cells.first().map(|cell| &cell.objects);
    let objects = objects.into_iter().flatten().map(|(group, n)| format!("{n} {group}")).collect::<Vec<_>>();
    let busy = if labels::busy(&results.cells).is_empty() { vec![] } else { vec!["BUSY MACHINE".to_owned()] };
    let frames = format!("{} labelled frames of {}", results.input.labelled, results.setup.source);
    let objects = format!("objects that count: {}", objects.join(", "));
    [vec![frames, objects], labels::devices(&results.cells), busy].concat().join(" · ")
}

/// Accuracy against a setting: one chart for each model and input size, and each combination of the other settings, with a line
/// for each stream and method. There is no chart of a single value.
fn over<'a>(results: &'a Results, varied: GridSetting) -> Vec<NamedChart> {
    let value = |cell: &Cell| varied.of(&cell.point);
    let with_others = |cells: Vec<&'a Cell>| -> Vec<(&'a Cell, SensorModel)> {
        cells.into_iter().map(|cell| (cell, varied.others(&cell.point))).collect()
    };
    let all = with_others(results.cells.iter().collect());
    let with_lens = with_others(labels::with_lens(&results.cells));
    let mut charts = Vec::new();
    for others in distinct(with_lens.iter().map(|(_, others)| others)) {
        let is_at = |(cell, own): &&(&Cell, SensorModel)| labels::is_at(&cell.point, own.clone(), others);
        if distinct(with_lens.iter().filter(is_at).map(|(cell, _)| value(cell))).len() < 2 {
            continue;
        }
        let mut cells: Vec<&Cell> = all.iter().filter(is_at).map(|(cell, _)| *cell).collect();
        // The line joins its points in this order. The cells have the order of the grid, in which the values are as the
        // user gave them.
        cells.sort_by(|a, b| value(a).total_cmp(&value(b)));
        let of_model = |model: &String| over_setting(results, &cells, model, (others, varied));
        charts.extend(models(&cells).iter().map(of_model));
    }
    charts
}

fn over_setting(
    results: &Results,
    cells: &[&Cell],
    model: &str,
    (others, setting): (&SensorModel, GridSetting),
) -> NamedChart {
    let of_model = cells.iter().filter(|cell| labels::model(&cell.point) == model);
    let cells: Vec<&Cell> = of_model.copied().collect();
    // A panel for each group: in one panel, the series of two groups would have the same names.
    let groups = distinct(cells.iter().flat_map(|cell| cell.ap50.keys()));
    let footer = "The settings are evenly spaced, and the points of one setting side by side. Bars: 95 % bootstrap \
                  intervals. Alpha: the brightest radiance over what the sensor holds. AP50: average precision at IoU \
                  0.5, one-to-one matching, ignore regions left out. The sharp ideal is what the scene would look like \
                  without a lens.";
    let without = [setting.0];
    let title = format!("Accuracy over {}: {model}, {}", setting.name(), labels::sensor(others, &without));
    let panels = groups.iter().map(|group| panel(&cells, group, setting)).collect();
    let name = format!("{}_{}_{}", setting.file(), file_name(model), labels::suffix(others, &without));
    NamedChart::new(name, title, results, footer, panels)
}

fn panel(cells: &[&Cell], group: &str, setting: GridSetting) -> ChartPanel {
    let names = distinct(cells.iter().map(|cell| labels::stream(&cell.point)));
    let series = |name: String| {
        let own = cells.iter().filter(|cell| labels::stream(&cell.point) == name);
        let points = own.filter_map(|cell| point(cell, group, setting)).collect();
        Series { name, points, style: SeriesStyle::LineAndMarkers }
    };
    ChartPanel {
        x: Axis::new(Scale::Settings, setting.axis()),
        y: Axis::new(Scale::Share, labels::ap50(group, cells)),
        series: names.into_iter().map(series).collect(),
    }
}

fn point(cell: &Cell, group: &str, setting: GridSetting) -> Option<DataPoint> {
    let (ap50, interval) = (cell.ap50_of(group)?, cell.interval_of(group));
    let bounds = interval.map(|bounds| format!(" (95 % interval {})", labels::bounds(bounds)));
    let x = setting.of(&cell.point);
    let (stream, at) = (labels::stream(&cell.point), setting.text(x));
    let (percent, bounds) = (number(100.0 * ap50, 1), bounds.unwrap_or_default());
    let hover = format!("{stream}, {at}: AP50 of {group} {percent} %{bounds}");
    Some(DataPoint { x, y: ap50, interval, hover, ..DataPoint::default() })
}
