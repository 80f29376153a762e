//! Cells as comma-separated values, one row a cell. Pure.

use std::collections::BTreeSet;

use crate::results::Cell;

/// A column: its name, and its value in a row.
type Column = (&'static str, fn(&Cell) -> String);

const PLACE: [Column; 9] = [
    ("stream", |cell| cell.point.stream.name().to_owned()),
    ("method", |cell| cell.point.method.clone().unwrap_or_default()),
    ("deblur", |cell| cell.point.deblur.to_string()),
    ("alpha", |cell| cell.point.alpha.to_string()),
    ("psf_sigma", |cell| cell.point.psf_sigma.to_string()),
    ("noise", |cell| cell.point.noise.to_string()),
    ("model", |cell| cell.point.model.clone()),
    ("input", |cell| cell.point.input.clone()),
    ("frames", |cell| cell.frames.to_string()),
];
const FIGURES: [Column; 9] = [
    ("ap50_95", |cell| number(cell.ap50_95)),
    ("paper_iou", |cell| number(Some(cell.paper.iou))),
    ("paper_f1", |cell| number(Some(cell.paper.f1))),
    ("paper_accuracy", |cell| number(Some(cell.paper.accuracy))),
    ("exact_k", |cell| number(cell.exact_k)),
    ("psnr_db", |cell| number(cell.psnr_db)),
    ("ssim", |cell| number(cell.ssim)),
    ("psnr_sharp_db", |cell| number(cell.psnr_sharp_db)),
    ("ssim_sharp", |cell| number(cell.ssim_sharp)),
];

/// The table with its head; a figure that a cell does not have is empty.
pub fn csv(cells: &[Cell]) -> Vec<u8> {
    let groups: BTreeSet<&String> = cells.iter().flat_map(|cell| cell.ap50.keys()).collect();
    let stages: BTreeSet<&String> = cells.iter().flat_map(|cell| cell.latency_ms.keys()).collect();
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut write = |row: Vec<String>| writer.write_record(row).expect("rows of one length fit into memory");
    let mut head: Vec<String> = PLACE.map(|(name, _)| name.to_owned()).to_vec();
    head.extend(groups.iter().map(|group| format!("ap50_{group}")));
    head.extend(FIGURES.map(|(name, _)| name.to_owned()));
    head.extend(stages.iter().map(|stage| format!("{stage}_ms_p50")));
    write(head);
    for cell in cells {
        let mut row: Vec<String> = PLACE.map(|(_, value)| value(cell)).to_vec();
        row.extend(groups.iter().map(|group| number(cell.ap50.get(*group).copied().flatten())));
        row.extend(FIGURES.map(|(_, value)| value(cell)));
        row.extend(stages.iter().map(|stage| number(cell.latency_ms.get(*stage).map(|p| p.p50))));
        write(row);
    }
    writer.into_inner().expect("memory can be flushed")
}

fn number(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| value.to_string())
}
