//! The two tables of the paper with the figures of the grid beside them.

use maud::{Markup, html};

use super::table::{Td, table};
use crate::grid::CAPTURES;
use crate::labels;
use crate::published::{CAPTURE_MS, Published};
use crate::results::{Cell, Results, Stream};

/// The section with the tables. It is empty if no model is one of the paper.
pub fn section(results: &Results) -> Markup {
    let known = |cell: &Cell| Published::of(&cell.point.model).is_some();
    let head =
        ["stream", "model", "alpha", "lens px", "noise", "IoU", "paper", "F1", "paper", "accuracy", "paper"];
    let rows: Vec<Vec<Td>> = results.cells.iter().filter_map(accuracy).collect();
    let times: Vec<Vec<Td>> = results.cells.iter().filter_map(time).collect();
    let time_head =
        ["stream", "model", "alpha", "capture, assumed", "merge or unwrap, tone", "detector", "sum", "paper"];
    html! {
        @if results.cells.iter().any(known) {
            h2 { "The paper's tables" }
            p {
                "Table 1, in percent. The paper used 100 KITTI images, the official weights, and SPUD for recovery. The "
                "other figures belong to the frames and the model named above."
            }
            (table(&head, &rows))
            p {
                "Table 2, in milliseconds. The paper assumes " (CAPTURE_MS) " ms for a capture, and " (CAPTURES)
                " captures for merged exposures. Its times were measured on an RTX 4070; the other times are medians on the "
                "processor named below."
            }
            (table(&time_head, &times))
        }
    }
}

fn accuracy(cell: &Cell) -> Option<Vec<Td>> {
    let published = Published::of(&cell.point.model)?.figures(cell.point.stream, cell.point.alpha);
    let theirs = |index: usize| Td::number(published.map(|figures| figures[index]), 1);
    let point = &cell.point;
    let mut row = vec![Td::Text(labels::stream(point)), Td::Text(labels::model(point))];
    row.extend([point.alpha, point.psf_sigma, point.noise].map(Td::setting));
    for (index, ours) in [cell.paper.iou, cell.paper.f1, cell.paper.accuracy].into_iter().enumerate() {
        row.extend([Td::percent(Some(ours)), theirs(index)]);
    }
    Some(row)
}

fn time(cell: &Cell) -> Option<Vec<Td>> {
    let published = Published::of(&cell.point.model)?;
    let sum = labels::frame_ms(cell)?;
    let of = |stages: &[&str]| {
        stages.iter().filter_map(|stage| cell.latency_ms.get(*stage)).map(|time| time.p50).sum::<f64>()
    };
    let (captures, theirs) = match cell.point.stream {
        Stream::Saturated | Stream::Modulo => (1.0, Some(published.ms()[0])),
        Stream::Recovered => (1.0, Some(published.ms()[1])),
        Stream::MultiExposure | Stream::MultiExposureStill => (CAPTURES as f64, Some(published.ms()[2])),
        // No sensor delivers the ideal image.
        Stream::Ideal => return None,
    };
    let capture = captures * CAPTURE_MS;
    let point = &cell.point;
    Some(vec![
        Td::Text(labels::stream(point)),
        Td::Text(labels::model(point)),
        Td::setting(point.alpha),
        Td::number(Some(capture), 0),
        Td::number(Some(of(&["merge", "unwrap", "tone", "deblur"])), 1),
        Td::number(Some(of(&["pre", "infer", "post"])), 1),
        Td::number(Some(capture + sum), 1),
        Td::number(theirs, 2),
    ])
}
