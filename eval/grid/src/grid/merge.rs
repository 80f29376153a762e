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
        return Err(GridError::OtherSetup(path.to_owned(), "the grid"));
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
    let (a, b) = (&old.setup, &new.setup);
    let differing = [
        ("the program's version", a.version != b.version),
        ("protocol", a.protocol != b.protocol),
        ("seed", a.seed != b.seed),
        ("difficulty", a.difficulty != b.difficulty),
        ("engine", a.engine != b.engine),
        ("class map", a.class_map != b.class_map),
        ("groups", a.groups != b.groups),
        ("models", a.models.iter().any(|(name, hash)| b.models.get(name).is_some_and(|other| other != hash))),
        ("data", old.input.digest != new.input.digest),
    ];
    match differing.iter().find(|(_, differs)| *differs) {
        None => Ok(()),
        Some((what, _)) => Err(GridError::OtherSetup(path.to_owned(), what)),
    }
}

/// Sorts the cells into the order of the grid.
pub fn sort(cells: &mut [Cell], points: &[Point]) {
    cells.sort_by_key(|cell| points.iter().position(|point| *point == cell.point).unwrap_or(usize::MAX));
}
