//! The figures of the paper beside those of the grid: a row for each stream, a column for each figure.

use modulo_charts::{Axis, ChartBody, ChartPanel, DataPoint, Emphasis, Series, SeriesStyle};

use super::{NamedChart, add_point, file_name, models, suffix};
use crate::labels::{self, Conditions};
use crate::published::{ALPHAS, Published};
use crate::results::{Cell, Protocol, Results, Stream};

/// Name of a figure of the paper and its value in a cell.
type Figure = (&'static str, fn(&Cell) -> f64);

const FIGURES: [Figure; 3] =
    [("IoU", |cell| cell.paper.iou), ("F1", |cell| cell.paper.f1), ("accuracy", |cell| cell.paper.accuracy)];
const STREAMS: [Stream; 4] = [Stream::Saturated, Stream::Modulo, Stream::Recovered, Stream::Ideal];

/// One chart for each model of the paper.
pub fn charts(results: &Results, conditions: Conditions) -> Vec<NamedChart> {
    let cells = super::cells(results, conditions);
    let chart = |model: String| {
        let own: Vec<&Cell> =
            cells.iter().filter(|cell| labels::model(&cell.point) == model).copied().collect();
        let published = Published::of(&own.first()?.point.model)?;
        Some(chart(results, &own, (&model, published), conditions))
    };
    models(&cells).into_iter().filter_map(chart).collect()
}

fn chart(
    results: &Results,
    cells: &[&Cell],
    (model, published): (&str, Published),
    conditions: Conditions,
) -> NamedChart {
    let protocol = match results.setup.protocol {
        Protocol::Suite => "the suite's protocol",
        Protocol::Paper => "the paper's protocol",
    };
    let panels = STREAMS.iter().flat_map(|stream| {
        FIGURES.iter().enumerate().map(|(index, figure)| panel(cells, published, *stream, index, *figure))
    });
    let title =
        format!("The paper's figures beside ours, {model}, {}, {protocol}", labels::conditions(conditions));
    let footer = format!(
        "Paper: table 1, YOLOv10{} with its official weights on 100 KITTI images that are not named. Ours: {} \
         labelled frames and the model file at hand; the figures are comparable in their course over alpha, not in \
         their height.",
        published.letter(),
        results.input.labelled
    );
    let name = format!("paper_{}_{}", file_name(model), suffix(conditions));
    NamedChart::new(name, title, results, footer, ChartBody::Panels(panels.collect()))
}

fn panel(
    cells: &[&Cell],
    published: Published,
    stream: Stream,
    index: usize,
    (name, value): Figure,
) -> ChartPanel {
    let theirs = ALPHAS.iter().filter_map(|alpha| {
        let figure = published.figures(stream, *alpha)?[index];
        Some(point(*alpha, figure / 100.0, &format!("paper, {}, {name}", stream.name())))
    });
    let mut series = vec![Series {
        name: "paper".to_owned(),
        points: theirs.collect(),
        style: SeriesStyle::LineAndMarkers,
    }];
    let mut own: Vec<&&Cell> = cells.iter().filter(|cell| cell.point.stream == stream).collect();
    own.sort_by(|a, b| a.point.alpha.total_cmp(&b.point.alpha));
    for cell in own {
        let called = labels::stream(&cell.point);
        let ours = match called.split_once('(') {
            Some((_, method)) => format!("ours, {}", method.trim_end_matches(')')),
            None if called.ends_with("sharp") => "ours, sharp".to_owned(),
            None => "ours".to_owned(),
        };
        let point = point(cell.point.alpha, value(cell), &format!("{ours}, {called}, {name}"));
        add_point(&mut series, ours, point, SeriesStyle::LineAndMarkers);
    }
    ChartPanel { x: Axis::log("alpha"), y: Axis::percent(format!("{name}, {}", stream.name()), 1.0), series }
}

fn point(alpha: f64, value: f64, what: &str) -> DataPoint {
    let hover = format!("{what}, alpha {alpha}: {:.1} %", 100.0 * value);
    DataPoint { x: alpha, y: value, label: String::new(), hover, emphasis: Emphasis::Normal }
}
