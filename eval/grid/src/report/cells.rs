//! The table of all cells, one row for each.

use maud::{Markup, html};

use super::table::{Td, table};
use crate::labels::{self, STAGES, distinct};
use crate::results::{Cell, Results};

/// The section with the table.
pub fn section(results: &Results) -> Markup {
    let groups = distinct(results.cells.iter().flat_map(|cell| cell.ap50.keys().cloned()));
    let timed = |stage: &&str| results.cells.iter().any(|cell| cell.latency_ms.contains_key(*stage));
    let stages: Vec<&str> = STAGES.into_iter().filter(timed).collect();
    let rows: Vec<Vec<Td>> = results.cells.iter().map(|cell| row(cell, &groups, &stages)).collect();
    html! {
        h2 { "All cells" }
        p {
            "Figures are in percent unless a unit is named. Click on the name of a column to sort by it. These and more "
            "figures are in results.json and results.csv beside this page."
        }
        (table(&head(&groups, &stages), &rows))
    }
}

fn head(groups: &[String], stages: &[&str]) -> Vec<String> {
    let point = ["stream", "alpha", "lens px", "noise", "model", "input", "frames"].map(str::to_owned);
    let ap50 = groups.iter().map(|group| format!("AP50 {group}"));
    let figures =
        ["AP50:95", "paper IoU", "F1", "accuracy", "exact k", "trusted", "PSNR dB", "SSIM", "ms a frame"];
    let stages = stages.iter().map(|stage| format!("{stage} ms p50 / p95 / p99"));
    point.into_iter().chain(ap50).chain(figures.map(str::to_owned)).chain(stages).collect()
}

fn row(cell: &Cell, groups: &[String], stages: &[&str]) -> Vec<Td> {
    let point = &cell.point;
    let mut row = vec![
        Td::Text(labels::stream(point)),
        Td::setting(point.alpha),
        Td::setting(point.psf_sigma),
        Td::setting(point.noise),
        Td::Text(point.model.clone()),
        Td::Text(point.input.clone()),
        Td::Number(frames(cell), Some(cell.frames as f64)),
    ];
    row.extend(groups.iter().map(|group| Td::percent(cell.ap50.get(group).copied().flatten())));
    row.push(Td::percent(cell.ap50_95));
    row.extend([cell.paper.iou, cell.paper.f1, cell.paper.accuracy].map(|figure| Td::percent(Some(figure))));
    row.extend([cell.exact_k, cell.trusted].map(Td::percent));
    row.extend([Td::number(cell.psnr_db, 2), Td::number(cell.ssim, 4)]);
    row.push(Td::number(labels::frame_ms(cell), 1));
    let stage = |stage: &&str| {
        let time = cell.latency_ms.get(*stage);
        let text = time.map(|t| format!("{:.1} / {:.1} / {:.1}", t.p50, t.p95, t.p99));
        Td::Number(text.unwrap_or_else(|| "-".to_owned()), time.map(|time| time.p50))
    };
    row.extend(stages.iter().map(stage));
    row
}

fn frames(cell: &Cell) -> String {
    match cell.unanswered {
        0 => cell.frames.to_string(),
        missing => format!("{}, {missing} unanswered", cell.frames),
    }
}
