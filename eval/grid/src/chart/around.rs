//! The accuracy over the time before and after a change of the light.

use modulo_draw::{Axis, ChartPanel, DataPoint, Scale, Series, SeriesStyle};

use super::{NamedChart, models};
use crate::labels::{self, distinct, number};
use crate::results::{Cell, Moment, Results, file_name};

/// A figure of a moment with the label of its axis.
type Figure = (&'static str, fn(&Moment) -> Option<f64>);

const FIGURES: [Figure; 2] =
    [("AP50, %", |moment| moment.ap50), ("frames whose nearest object is found, %", |moment| moment.nearest)];

/// One chart for each model and sensor whose cells have seen a change of the light, and each direction of the change.
pub fn charts(results: &Results) -> Vec<NamedChart> {
    let cells: Vec<&Cell> = results.cells.iter().filter(|cell| !cell.moments.is_empty()).collect();
    let mut charts = Vec::new();
    let sensor = |cell: &Cell| (labels::conditions_of(&cell.point), cell.point.sensor.alpha);
    for (conditions, alpha) in distinct(labels::with_lens(&results.cells).into_iter().map(sensor)) {
        for model in models(&cells) {
            for is_darker in [true, false] {
                let here = |cell: &&&Cell| {
                    cell.point.sensor.alpha == alpha
                        && labels::belongs(&cell.point, &conditions)
                        && labels::model(&cell.point) == model
                };
                let own: Vec<&Cell> = cells.iter().filter(here).copied().collect();
                let panels: Vec<_> = FIGURES.iter().map(|figure| panel(&own, *figure, is_darker)).collect();
                if panels[0].series.is_empty() {
                    continue;
                }
                let word = if is_darker { "darker" } else { "brighter" };
                let title = format!(
                    "Before and after the light gets {word}: {model}, alpha {alpha}, {}",
                    labels::conditions(&conditions)
                );
                let suffix = labels::suffix(&conditions, &["alpha"]);
                let name = format!("around_{word}_{}_alpha{alpha}_{suffix}", file_name(&model));
                let footer = "Frame 0 is the first one of the change. A moment has the frames of all changes of this kind in all drives. The nearest object \
                              of a frame has the highest box of those that count; it is found by a box of a score of at least 0.25 and an \
                              IoU of at least 0.5.";
                charts.push(NamedChart::new(file_name(&name), title, results, footer, panels));
            }
        }
    }
    charts
}

fn panel(cells: &[&Cell], (label, figure): Figure, is_darker: bool) -> ChartPanel {
    let series = |cell: &&Cell| {
        let name = labels::stream(&cell.point);
        let here = cell.moments.iter().filter(|moment| moment.is_darker == is_darker);
        let point = |moment: &Moment| {
            let y = figure(moment)?;
            let hover = format!("{name}, frame {}: {} %", moment.frame, number(100.0 * y, 1));
            Some(DataPoint { x: moment.frame as f64, y, hover, ..DataPoint::default() })
        };
        let points: Vec<DataPoint> = here.filter_map(point).collect();
        (!points.is_empty()).then_some(Series { name, points, style: SeriesStyle::LineAndMarkers })
    };
    ChartPanel {
        x: Axis::new(Scale::Linear, "frames after the change of the light"),
        y: Axis::new(Scale::Share, label),
        series: cells.iter().filter_map(series).collect(),
    }
}
