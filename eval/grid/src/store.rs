//! Results as files. A file is complete at any time, even if the process is killed.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use modulo_runtime::input::read_bytes;
use modulo_runtime::output;
use serde_json::Value;

use crate::GridError;
use crate::labels;
use crate::results::{Cell, FRAMES, Input, Point, RESULTS, Results, Setup};

/// Size of the largest results, bytes.
const LARGEST: u64 = 1 << 30;

/// Reads the results in `folder`. `None` if there are no results.
///
/// # Errors
/// [`GridError`] if they cannot be read.
pub fn load(folder: &Path) -> Result<Option<Results>, GridError> {
    let path = folder.join(RESULTS);
    match read_bytes(&path, LARGEST) {
        Ok(text) => {
            let json = |why| GridError::Results(format!("{}: {why}", path.display()));
            serde_json::from_slice(&text).map(Some).map_err(json)
        }
        Err(why) if why.kind() == ErrorKind::NotFound => Ok(None),
        Err(why) => Err(GridError::io(&path, why)),
    }
}

/// Reads the results in `folder`.
///
/// # Errors
/// [`GridError`] if there are none, or they cannot be read.
pub fn stored(folder: &Path) -> Result<Results, GridError> {
    let path = folder.join(RESULTS);
    let missing = || {
        GridError::Results(format!("{}: there are no results; modulo eval --out writes them", path.display()))
    };
    load(folder)?.ok_or_else(missing)
}

/// Writes [`RESULTS`]. Creates `folder` if it is missing.
///
/// # Errors
/// [`GridError`] if it cannot be written.
pub fn save(folder: &Path, results: &Results) -> Result<(), GridError> {
    let path = folder.join(RESULTS);
    let mut text = serde_json::to_vec_pretty(results).expect("results have text keys");
    text.push(b'\n');
    replace(&path, &text)
}

/// The results in `folder` with the grid of `empty`, which has no cell yet, or `empty` alone if there are none or they are
/// `replaced`. Cells that cannot be shown together, and a file that is none of a grid, are refused, and the folder stays as it is.
pub(crate) fn resume(folder: &Path, replaced: bool, empty: Results) -> Result<Results, GridError> {
    let other =
        |why| GridError::Request(format!("{why}; the file is none of a grid, so choose another folder"));
    let Some(old) = load(folder).map_err(other)? else { return Ok(empty) };
    if replaced {
        // It fails where a cell has no frames.
        old.cells.iter().for_each(|cell| drop(std::fs::remove_file(frames_of(folder, cell))));
        return Ok(empty);
    }
    check_same(&folder.join(RESULTS), &old, &empty)?;
    Ok(joined(old, empty))
}

/// Stores a finished cell with the lines of its frames.
pub(crate) fn keep(folder: &Path, results: &mut Results, cell: Cell, frames: &[u8]) -> Result<(), GridError> {
    // The frames come first: a cell without them would never be run again.
    replace(&frames_of(folder, &cell), frames)?;
    results.cells.push(cell);
    // Cells of an earlier run may come later in the grid.
    sort(&mut results.cells, &results.setup.grid);
    save(folder, results)
}

fn frames_of(folder: &Path, cell: &Cell) -> PathBuf {
    folder.join(FRAMES).join(format!("{}.jsonl", cell.point.file_name()))
}

/// The grid and the cells of `old` with those of `fresh`, which has no cell yet.
fn joined(old: Results, fresh: Results) -> Results {
    let Results { setup, input, definitions, .. } = fresh;
    let mut models = old.setup.models;
    models.extend(setup.models);
    let mut without_twin = old.input.without_twin;
    without_twin.extend(input.without_twin);
    let grid = joined_grid(old.setup.grid, setup.grid);
    let mut cells = old.cells;
    sort(&mut cells, &grid);
    Results {
        setup: Setup { models, grid, ..setup },
        input: Input { without_twin, ..input },
        definitions,
        cells,
        runs: old.runs,
    }
}

/// The order of `new` if it has all points of `old`; else the points of `old`, then the other points of `new`.
fn joined_grid(old: Vec<Point>, new: Vec<Point>) -> Vec<Point> {
    if old.iter().all(|point| new.contains(point)) {
        return new;
    }
    let more: Vec<Point> = new.into_iter().filter(|point| !old.contains(point)).collect();
    [old, more].concat()
}

/// Replaces the content of `path` by `bytes`, as [`output::replace`] does. Creates its folder if it is missing.
pub(crate) fn replace(path: &Path, bytes: &[u8]) -> Result<(), GridError> {
    let folder = path.parent().map_or(Ok(()), std::fs::create_dir_all);
    folder.and_then(|()| output::replace(path, bytes)).map_err(|why| GridError::io(path, why))
}

/// Refuses the results `old` at `path` if they belong to another request than `new`. The grids may differ.
fn check_same(path: &Path, old: &Results, new: &Results) -> Result<(), GridError> {
    let Some((what, a, b)) = difference(old, new) else { return Ok(()) };
    let [old, new] = [old, new].map(|results| labels::grid(&results.setup.grid));
    let why = format!("its {what} is {a}, and that of this command is {b}. There: {old}. Here: {new}");
    let refused = "holds results that cannot be shown with those of this command";
    let remedy = "choose another folder, or start anew with --fresh";
    Err(GridError::of_file(path, format!("{refused}: {why}; {remedy}")))
}

/// The first setting that must be the same in `old` and `new` and is not, with both values.
fn difference(old: &Results, new: &Results) -> Option<(String, String, String)> {
    if old.input.digest != new.input.digest {
        let data = |of: &Results| format!("{} (sha256 {})", of.setup.source, of.input.digest);
        return Some(("data".to_owned(), data(old), data(new)));
    }
    let of = |results: &Results, others: &Results| {
        // A run may add models. Only a model that both know must be the same file.
        let mut setup = Setup { grid: Vec::new(), source: String::new(), ..results.setup.clone() };
        setup.models.retain(|name, _| others.setup.models.contains_key(name));
        serde_json::to_value(setup).expect("a setup has text keys")
    };
    let (old, new) = (of(old, new), of(new, old));
    let differs = |(name, value): (&String, &Value)| {
        (new[name] != *value).then(|| (name.replace('_', " "), value.to_string(), new[name].to_string()))
    };
    old.as_object()?.iter().find_map(differs)
}

/// Sorts the cells into the order of the grid.
pub(crate) fn sort(cells: &mut [Cell], points: &[Point]) {
    cells.sort_by_key(|cell| points.iter().position(|point| *point == cell.point).unwrap_or(usize::MAX));
}
