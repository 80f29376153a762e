//! [`merge`]: shards put together. Nothing is measured here.

use std::path::{Path, PathBuf};

use super::GridError;
use crate::results::{Cell, RESULTS, Results};
use crate::store;

/// Puts the results of all `folders` together in `out`, cells in the order of the first shard's grid.
///
/// # Errors
/// [`GridError`] when one has none, when they are of different setups, or when a cell was measured twice with
/// different figures (durations may differ, the first ones are kept).
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
    super::run::sort(&mut all.cells, &all.setup.grid);
    store::save(out, &all)?;
    Ok(all)
}

fn add(all: &mut Results, part: Results, path: &Path) -> Result<(), GridError> {
    same(path, &part, all)?;
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

/// What must be the same on every run.
fn timeless(cell: &Cell) -> Cell {
    Cell { latency_ms: Default::default(), device: Default::default(), ..cell.clone() }
}

/// Refuses `old`, which lies at `path`, when its cells cannot stand beside those of `new`. Grids may differ.
pub(super) fn same(path: &Path, old: &Results, new: &Results) -> Result<(), GridError> {
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
