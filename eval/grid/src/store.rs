//! Results as files, and the joining of shards. A file is complete at any time, even if the process is killed.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use modulo_runtime::launcher;

use crate::GridError;
use crate::results::{Cell, Point, RESULTS, Results, TABLE};

/// Reads the results in `folder`. `None` if there are no results.
///
/// # Errors
/// [`GridError`] if they cannot be read.
pub fn load(folder: &Path) -> Result<Option<Results>, GridError> {
    let path = folder.join(RESULTS);
    match std::fs::read(&path) {
        Ok(text) => {
            let json = |source| GridError::Json(path.clone(), source);
            serde_json::from_slice(&text).map(Some).map_err(json)
        }
        Err(why) if why.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(why) => Err(GridError::io(&path, why)),
    }
}

/// Writes [`RESULTS`] and [`TABLE`]. Creates `folder` if it is missing.
///
/// # Errors
/// [`GridError`] if they cannot be written.
pub fn save(folder: &Path, results: &Results) -> Result<(), GridError> {
    std::fs::create_dir_all(folder).map_err(|why| GridError::io(folder, why))?;
    let path = folder.join(RESULTS);
    let mut text =
        serde_json::to_vec_pretty(results).map_err(|source| GridError::Json(path.clone(), source))?;
    text.push(b'\n');
    replace(&path, &text)?;
    replace(&folder.join(TABLE), &csv(&results.cells))
}

/// Replaces the content of `path` by `bytes`, as [`launcher::replace`] does.
pub(crate) fn replace(path: &Path, bytes: &[u8]) -> Result<(), GridError> {
    launcher::replace(path, bytes).map_err(|why| GridError::io(path, why))
}

/// Name of a column and its value in the row of a cell.
type Column = (&'static str, fn(&Cell) -> String);

const SETTINGS: [Column; 9] = [
    ("stream", |cell| cell.point.stream.name()),
    ("method", |cell| cell.point.method.as_deref().unwrap_or("").to_owned()),
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

/// The cells as comma-separated values, one row for each cell. A missing figure is an empty field.
fn csv(cells: &[Cell]) -> Vec<u8> {
    // The columns are the union over all cells: cells of different streams have different stages.
    let groups: BTreeSet<&String> = cells.iter().flat_map(|cell| cell.ap50.keys()).collect();
    let stages: BTreeSet<&String> = cells.iter().flat_map(|cell| cell.latency_ms.keys()).collect();
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut write = |row: Vec<String>| writer.write_record(row).expect("rows of one length fit into memory");
    let mut head: Vec<String> = SETTINGS.map(|(name, _)| name.to_owned()).to_vec();
    head.extend(groups.iter().map(|group| format!("ap50_{group}")));
    head.extend(FIGURES.map(|(name, _)| name.to_owned()));
    head.extend(stages.iter().map(|stage| format!("{stage}_ms_p50")));
    write(head);
    for cell in cells {
        let mut row: Vec<String> = SETTINGS.map(|(_, value)| value(cell)).to_vec();
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

/// Joins the results of all `folders` in `out`, with the cells in the order of the grid.
///
/// # Errors
/// [`GridError`] if a folder has no results, if the folders belong to different requests, or if two of them hold different
/// figures for one cell. Durations may differ: those of the first folder are kept.
pub fn merge(out: &Path, folders: &[PathBuf]) -> Result<Results, GridError> {
    let mut all: Option<Results> = None;
    for folder in folders {
        let path = folder.join(RESULTS);
        let Some(part) = load(folder)? else {
            return Err(GridError::io(&path, std::io::ErrorKind::NotFound.into()));
        };
        match &mut all {
            None => all = Some(part),
            Some(all) => add(all, part, &path)?,
        }
    }
    let mut all = all.ok_or(GridError::Empty("the list of folders"))?;
    sort(&mut all.cells, &all.setup.grid);
    save(out, &all)?;
    Ok(all)
}

fn add(all: &mut Results, part: Results, path: &Path) -> Result<(), GridError> {
    check_same(path, &part, all)?;
    if part.setup.grid != all.setup.grid {
        return Err(GridError::OtherSetup(path.to_owned(), "its cells are those of another grid".to_owned()));
    }
    all.runs.extend(part.runs);
    for cell in part.cells {
        match all.cells.iter().find(|known| known.point == cell.point) {
            None => all.cells.push(cell),
            // All figures but durations are the same in every run. Different figures of one cell cannot both be right,
            // and a merge cannot decide between them.
            Some(known) if timeless(known) == timeless(&cell) => {}
            Some(_) => {
                return Err(GridError::Contradiction(path.to_owned(), cell.point.to_string()));
            }
        }
    }
    Ok(())
}

/// The figures of a cell that must be the same in every run.
fn timeless(cell: &Cell) -> Cell {
    let (latency_ms, latency_histogram, device) = Default::default();
    Cell { latency_ms, latency_histogram, device, frame_ms: None, ..cell.clone() }
}

/// Refuses the results `old` at `path` if they belong to another request than `new`. The grids may differ.
pub(crate) fn check_same(path: &Path, old: &Results, new: &Results) -> Result<(), GridError> {
    let pair = |of: fn(&Results) -> String| (of(old), of(new));
    // Shards may have different models. Only a model that both know must be the same file.
    let known = |name: &&String| old.setup.models.contains_key(*name) && new.setup.models.contains_key(*name);
    let models = |results: &Results| {
        let shared = results.setup.models.iter().filter(|(name, _)| known(name));
        shared.map(|(name, hash)| format!("{name} sha256 {hash} ")).collect::<String>()
    };
    let compared = [
        ("program version", pair(|results| results.setup.version.clone())),
        ("version of the figures", pair(|results| results.setup.figures.to_string())),
        ("protocol", pair(|results| format!("{:?}", results.setup.protocol))),
        ("seed", pair(|results| results.setup.seed.to_string())),
        ("difficulty", pair(|results| format!("{:?}", results.setup.difficulty))),
        ("engine", pair(|results| results.setup.engine.clone())),
        ("class map", pair(|results| format!("{:?}", results.setup.class_map))),
        ("groups", pair(|results| format!("{:?}", results.setup.groups))),
        ("models", (models(old), models(new))),
        ("data", pair(|results| format!("{} (sha256 {})", results.setup.source, results.input.digest))),
    ];
    // The name of the data may differ, where only the folder was moved.
    let differs = |what: &str, a: &str, b: &str| match what {
        "data" => old.input.digest != new.input.digest,
        _ => a != b,
    };
    match compared.iter().find(|(what, (a, b))| differs(what, a, b)) {
        None => Ok(()),
        Some((what, (a, b))) => {
            let why = format!("its {what} is {a}, and this request has {b}");
            Err(GridError::OtherSetup(path.to_owned(), why))
        }
    }
}

/// Sorts the cells into the order of the grid.
pub(crate) fn sort(cells: &mut [Cell], points: &[Point]) {
    cells.sort_by_key(|cell| points.iter().position(|point| *point == cell.point).unwrap_or(usize::MAX));
}
