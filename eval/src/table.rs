//! Cells as comma-separated values, one row a cell. Pure.

use std::collections::BTreeSet;

use crate::results::Cell;

/// The table with its head; a figure that a cell does not have is empty.
pub fn csv(cells: &[Cell]) -> String {
    let groups: BTreeSet<&String> = cells.iter().flat_map(|cell| cell.ap50.keys()).collect();
    let stages: BTreeSet<&String> = cells.iter().flat_map(|cell| cell.latency_ms.keys()).collect();
    let mut head: Vec<String> = HEAD.map(str::to_owned).to_vec();
    head.extend(groups.iter().map(|group| format!("ap50_{group}")));
    head.extend(FIGURES.map(str::to_owned));
    head.extend(stages.iter().map(|stage| format!("{stage}_ms_p50")));
    let mut text = head.join(",") + "\n";
    for cell in cells {
        let mut row = place(cell);
        row.extend(groups.iter().map(|group| number(cell.ap50.get(*group).copied().flatten())));
        row.extend(figures(cell).map(number));
        row.extend(stages.iter().map(|stage| number(cell.latency_ms.get(*stage).map(|p| p.p50))));
        text += &(row.join(",") + "\n");
    }
    text
}

const HEAD: [&str; 9] =
    ["stream", "method", "deblur", "alpha", "psf_sigma", "noise", "model", "input", "frames"];
const FIGURES: [&str; 9] = [
    "ap50_95",
    "paper_iou",
    "paper_f1",
    "paper_accuracy",
    "exact_k",
    "psnr_db",
    "ssim",
    "psnr_sharp_db",
    "ssim_sharp",
];

fn place(cell: &Cell) -> Vec<String> {
    let point = &cell.point;
    vec![
        point.stream.name().to_owned(),
        point.method.clone().unwrap_or_default(),
        point.deblur.to_string(),
        point.alpha.to_string(),
        point.psf_sigma.to_string(),
        point.noise.to_string(),
        quoted(&point.model),
        point.input.clone(),
        cell.frames.to_string(),
    ]
}

fn figures(cell: &Cell) -> [Option<f64>; 9] {
    let paper = cell.paper;
    [
        cell.ap50_95,
        Some(paper.iou),
        Some(paper.f1),
        Some(paper.accuracy),
        cell.exact_k,
        cell.psnr_db,
        cell.ssim,
        cell.psnr_sharp_db,
        cell.ssim_sharp,
    ]
}

fn number(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| value.to_string())
}

/// A file's name may hold anything.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_with_a_comma_is_one_field() {
        assert_eq!(quoted("a,b\"c"), "\"a,b\"\"c\"");
        assert_eq!(quoted("yolov10n"), "yolov10n");
    }

    #[test]
    fn without_cells_there_is_a_head() {
        assert_eq!(csv(&[]).lines().count(), 1);
    }
}
