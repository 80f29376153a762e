//! [`merge`]: joins the results of shards.

use std::path::{Path, PathBuf};

use super::GridError;
use crate::results::{Cell, Point, RESULTS, Results};
use crate::store;

/// Joins the results of all `folders` in `out`, with the cells in the order of the grid.
///
/// # Errors
/// [`GridError`] if a folder has no results, if the folders belong to different requests, or if two of them hold different
/// figures for one cell. Durations may differ: those of the first folder are kept.
pub fn merge(out: &Path, folders: &[PathBuf]) -> Result<Results, GridError> {
    let mut all: Option<Results> = None;
    for folder in folders {
        let path = folder.join(RESULTS);
        let Some(part) = store::load(folder)? else {
            return Err(GridError::io(&path, std::io::ErrorKind::NotFound.into()));
        };
        match &mut all {
            None => all = Some(part),
            Some(all) => add(all, part, &path)?,
        }
    }
    let mut all = all.ok_or(GridError::Empty("the list of folders"))?;
    sort(&mut all.cells, &all.setup.grid);
    store::save(out, &all)?;
    Ok(all)
}

fn add(all: &mut Results, part: Results, path: &Path) -> Result<(), GridError> {
    check_same(path, &part, all)?;
    if part.setup.grid != all.setup.grid {
        return Err(GridError::OtherSetup(path.to_owned(), "its cells are those of another grid".to_owned()));
    }
    for cell in part.cells {
        match all.cells.iter().find(|known| known.point == cell.point) {
            None => all.cells.push(cell),
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
    Cell { latency_ms: Default::default(), device: Default::default(), ..cell.clone() }
}

/// Refuses the results `old` at `path` if they belong to another request than `new`. The grids may differ.
pub fn check_same(path: &Path, old: &Results, new: &Results) -> Result<(), GridError> {
    let pair = |of: fn(&Results) -> String| (of(old), of(new));
    let known = |name: &&String| old.setup.models.contains_key(*name) && new.setup.models.contains_key(*name);
    let models = |results: &Results| {
        let shared = results.setup.models.iter().filter(|(name, _)| known(name));
        shared.map(|(name, hash)| format!("{name} sha256 {hash} ")).collect::<String>()
    };
    let compared = [
        ("program version", pair(|results| results.setup.version.clone())),
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
pub fn sort(cells: &mut [Cell], points: &[Point]) {
    cells.sort_by_key(|cell| points.iter().position(|point| *point == cell.point).unwrap_or(usize::MAX));
}
