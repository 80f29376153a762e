//! The paper's figures beside ours: a row a stream, a column a figure.

use modulo_charts::{Axis, Body, Look, Panel, Point, Series, Tone};

use super::{Named, file_name, suffix};
use crate::published::{ALPHAS, Published};
use crate::results::{Cell, Protocol, Results, Stream};
use crate::wording::{self, Conditions, distinct};

/// Name and value of the paper's figures.
type Figure = (&'static str, fn(&Cell) -> f64);

const FIGURES: [Figure; 3] =
    [("IoU", |cell| cell.paper.iou), ("F1", |cell| cell.paper.f1), ("accuracy", |cell| cell.paper.accuracy)];
const STREAMS: [Stream; 4] = [Stream::Saturated, Stream::Modulo, Stream::Recovered, Stream::Ideal];

/// One for each model that the paper has too.
pub fn charts(results: &Results, conditions: Conditions) -> Vec<Named> {
    let of = |cell: &&Cell| wording::belongs(&cell.point, conditions);
    let cells: Vec<&Cell> = results.cells.iter().filter(of).collect();
    let models = distinct(cells.iter().map(|cell| wording::model(&cell.point)));
    let chart = |model: String| {
        let own: Vec<&Cell> =
            cells.iter().filter(|cell| wording::model(&cell.point) == model).copied().collect();
        let published = Published::of(&own.first()?.point.model)?;
        Some(chart(results, &own, (&model, published), conditions))
    };
    models.into_iter().filter_map(chart).collect()
}

fn chart(
    results: &Results,
    cells: &[&Cell],
    (model, published): (&str, Published),
    conditions: Conditions,
) -> Named {
    let protocol = match results.setup.protocol {
        Protocol::Suite => "the suite's protocol",
        Protocol::Paper => "the paper's protocol",
    };
    let panels = STREAMS.iter().flat_map(|stream| {
        FIGURES.iter().enumerate().map(|(index, figure)| panel(cells, published, *stream, index, *figure))
    });
    let title =
        format!("The paper's figures beside ours, {model}, {}, {protocol}", wording::conditions(conditions));
    let footer = format!(
        "Paper: table 1, YOLOv10{} with its official weights on 100 KITTI images that are not named. Ours: {} \
         labelled frames and the model file at hand; the figures are comparable in their course over alpha, not in \
         their height.",
        published.letter(),
        results.input.labelled
    );
    let name = format!("paper_{}_{}", file_name(model), suffix(conditions));
    Named::new(name, title, results, footer, Body::Panels(panels.collect()))
}

fn panel(
    cells: &[&Cell],
    published: Published,
    stream: Stream,
    index: usize,
    (name, value): Figure,
) -> Panel {
    let theirs = ALPHAS.iter().filter_map(|alpha| {
        let figure = published.figures(stream, *alpha)?[index];
        Some(point(*alpha, figure / 100.0, &format!("paper, {}, {name}", stream.name())))
    });
    let mut series = vec![Series { name: "paper".to_owned(), points: theirs.collect(), look: Look::Joined }];
    let mut own: Vec<&&Cell> = cells.iter().filter(|cell| cell.point.stream == stream).collect();
    own.sort_by(|a, b| a.point.alpha.total_cmp(&b.point.alpha));
    for cell in own {
        let called = wording::stream(&cell.point);
        let ours = match called.split_once('(') {
            Some((_, method)) => format!("ours, {}", method.trim_end_matches(')')),
            None if called.ends_with("sharp") => "ours, sharp".to_owned(),
            None => "ours".to_owned(),
        };
        let point = point(cell.point.alpha, value(cell), &format!("{ours}, {called}, {name}"));
        match series.iter_mut().find(|series| series.name == ours) {
            Some(series) => series.points.push(point),
            None => series.push(Series { name: ours, points: vec![point], look: Look::Joined }),
        }
    }
    Panel { x: Axis::log("alpha"), y: Axis::percent(format!("{name}, {}", stream.name()), 1.0), series }
}

fn point(alpha: f64, value: f64, what: &str) -> Point {
    let hover = format!("{what}, alpha {alpha}: {:.1} %", 100.0 * value);
    Point { x: alpha, y: value, label: String::new(), hover, tone: Tone::Full }
}
