//! Results as files, and the joining of shards. A file is complete at any time, even if the process is killed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use csv::{ByteRecord, ByteRecordsIntoIter};
use modulo_runtime::input::read_bytes;
use modulo_runtime::{ParameterSet as _, SensorModel, Value, launcher};

use crate::GridError;
use crate::labels;
use crate::results::{BOXES, Cell, FRAMES, Input, Point, RESULTS, Results, Setup, TABLE};

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
            let json = |source| GridError::Json(path.clone(), source);
            serde_json::from_slice(&text).map(Some).map_err(json)
        }
        Err(why) if why.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(why) => Err(GridError::io(&path, why)),
    }
}

/// Creates `folder` and checks that a file can be written into it.
///
/// # Errors
/// [`GridError::Output`] if that fails.
pub fn prepare(folder: &Path) -> Result<(), GridError> {
    let probe = folder.join(format!(".modulo-{}", std::process::id()));
    let written = std::fs::create_dir_all(folder).and_then(|()| std::fs::write(&probe, []));
    let done = written.and_then(|()| std::fs::remove_file(&probe));
    done.map_err(|why| GridError::Output(folder.to_owned(), why))
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

/// The results in `folder` with the grid of `empty`, which has no cell yet, or `empty` alone if there are none or they are
/// `replaced`.
///
/// # Errors
/// [`GridError::OtherSetup`] if the cells of both cannot be shown together; the folder stays as it is.
pub(crate) fn resume(folder: &Path, replaced: bool, empty: Results) -> Result<Results, GridError> {
    let old = if replaced { None } else { load(folder)? };
    let results = match old {
        Some(old) => {
            check_same(&folder.join(RESULTS), &old, &empty)?;
            joined(old, empty)
        }
        None => empty,
    };
    // Lines of cells that were not finished are left out: these cells are run again.
    gather(folder, &[folder.to_owned()], &results.cells)?;
    Ok(results)
}

/// Stores a finished cell with its lines of frames and of boxes.
pub(crate) fn keep(
    folder: &Path,
    results: &mut Results,
    cell: Cell,
    [frames, boxes]: [&CellLines; 2],
) -> Result<(), GridError> {
    // The lines come first: a cell without lines would never be run again.
    append(folder, FRAMES, frames)?;
    append(folder, BOXES, boxes)?;
    results.cells.push(cell);
    // Cells of an earlier run may come later in the grid.
    sort(&mut results.cells, &results.setup.grid);
    save(folder, results)
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

/// Replaces the content of `path` by `bytes`, as [`launcher::replace`] does.
pub(crate) fn replace(path: &Path, bytes: &[u8]) -> Result<(), GridError> {
    launcher::replace(path, bytes).map_err(|why| GridError::io(path, why))
}

/// Name of a column and its value in the row of a cell.
type Column = (&'static str, fn(&Cell) -> String);

const FIGURES: [Column; 9] = [
    ("ap50_95", |cell| figure(cell.ap50_95)),
    ("paper_iou", |cell| figure(Some(cell.paper.iou))),
    ("paper_f1", |cell| figure(Some(cell.paper.f1))),
    ("paper_accuracy", |cell| figure(Some(cell.paper.accuracy))),
    ("exact_k", |cell| figure(cell.exact_k)),
    ("psnr_db", |cell| figure(cell.psnr_db)),
    ("ssim", |cell| figure(cell.ssim)),
    ("psnr_sharp_db", |cell| figure(cell.psnr_sharp_db)),
    ("ssim_sharp", |cell| figure(cell.ssim_sharp)),
];

/// The cells as comma-separated values, one row for each cell. A missing figure is an empty field.
fn csv(cells: &[Cell]) -> Vec<u8> {
    // The columns are the union over all cells: cells of different streams have different stages.
    let groups: BTreeSet<&String> = cells.iter().flat_map(|cell| cell.ap50.keys()).collect();
    let stages: BTreeSet<&String> = cells.iter().flat_map(|cell| cell.latency_ms.keys()).collect();
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut write = |row: Vec<String>| writer.write_record(row).expect("rows of one length fit into memory");
    let mut head = ["cell", "stream", "method", "deblur"].map(str::to_owned).to_vec();
    head.extend(SensorModel::descriptors().iter().map(|parameter| parameter.name.to_owned()));
    head.extend(["model", "input", "frames"].map(str::to_owned));
    head.extend(groups.iter().map(|group| format!("ap50_{group}")));
    head.extend(FIGURES.map(|(name, _)| name.to_owned()));
    head.extend(stages.iter().map(|stage| format!("{stage}_ms_p50")));
    write(head);
    for cell in cells {
        let Point { stream, method, deblur, sensor, model, input } = &cell.point;
        let method = method.clone().unwrap_or_default();
        let mut row = vec![cell.point.to_string(), stream.name(), method, deblur.to_string()];
        row.extend(sensor.values().iter().map(Value::plain));
        row.extend([model.clone(), input.clone(), cell.frames.to_string()]);
        row.extend(groups.iter().map(|group| figure(cell.ap50.get(*group).copied().flatten())));
        row.extend(FIGURES.map(|(_, value)| value(cell)));
        row.extend(stages.iter().map(|stage| figure(cell.latency_ms.get(*stage).map(|p| p.p50))));
        write(row);
    }
    writer.into_inner().expect("memory can be flushed")
}

/// A figure with all its digits; empty without a value.
pub(crate) fn figure(value: Option<f64>) -> String {
    // The sum with 0 removes the sign of a zero.
    value.map_or(String::new(), |value| (value + 0.0).to_string())
}

/// Lines of a table whose first column is the name of a cell.
pub(crate) struct CellLines {
    /// The names of the columns.
    pub head: Vec<String>,
    /// The values of each line.
    pub lines: Vec<Vec<String>>,
}

/// Adds lines to the table `file` in `folder`. Creates both if they are missing.
///
/// # Errors
/// [`GridError`] if the table has other columns, or cannot be read or written.
fn append(folder: &Path, file: &str, lines: &CellLines) -> Result<(), GridError> {
    let path = folder.join(file);
    std::fs::create_dir_all(folder).map_err(|why| GridError::io(folder, why))?;
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut write =
        |line: &Vec<String>| writer.write_record(line).expect("lines of one length fit into memory");
    match read(&path)? {
        Some((head, _)) if head != lines.head => return Err(other_columns(&path)),
        Some(_) => {}
        None => write(&lines.head),
    }
    lines.lines.iter().for_each(write);
    let bytes = writer.into_inner().expect("memory can be flushed");
    let file = File::options().create(true).append(true).open(&path);
    file.and_then(|mut file| file.write_all(&bytes)).map_err(|why| GridError::io(&path, why))
}

/// Writes the tables of frames and boxes in `out` anew: the lines of `cells` in `folders`, in the order of `cells`. A cell has
/// the lines of the first folder that knows it. Without cells, the tables are removed.
///
/// # Errors
/// [`GridError`] if tables have different columns, or cannot be read or written.
pub(crate) fn gather(out: &Path, folders: &[PathBuf], cells: &[Cell]) -> Result<(), GridError> {
    for file in [FRAMES, BOXES] {
        let path = out.join(file);
        if cells.is_empty() && path.exists() {
            std::fs::remove_file(&path).map_err(|why| GridError::io(&path, why))?;
        } else if let Some(bytes) = gathered(folders, file, cells)? {
            replace(&path, &bytes)?;
        }
    }
    Ok(())
}

/// The table `file` of all `folders` with the lines of `cells`. `None` if no folder has it.
fn gathered(folders: &[PathBuf], file: &str, cells: &[Cell]) -> Result<Option<Vec<u8>>, GridError> {
    let places = cells.iter().enumerate().map(|(place, cell)| (cell.point.to_string().into_bytes(), place));
    let places: BTreeMap<Vec<u8>, usize> = places.collect();
    let mut head: Option<ByteRecord> = None;
    let mut lines: BTreeMap<usize, (&PathBuf, Vec<ByteRecord>)> = BTreeMap::new();
    for folder in folders {
        let path = folder.join(file);
        let Some((own, records)) = read(&path)? else { continue };
        if head.get_or_insert_with(|| own.clone()) != &own {
            return Err(other_columns(&path));
        }
        for record in records {
            let record = record.map_err(|why| GridError::io(&path, why.into()))?;
            // The last line is cut if the process was killed.
            let name = record.get(0).filter(|_| record.len() == own.len());
            let Some(place) = name.and_then(|name| places.get(name)) else { continue };
            let (from, known) = lines.entry(*place).or_insert((folder, Vec::new()));
            if *from == folder {
                known.push(record);
            }
        }
    }
    let mut writer = csv::Writer::from_writer(Vec::new());
    let all = head.iter().chain(lines.values().flat_map(|(_, records)| records));
    all.for_each(|line| writer.write_byte_record(line).expect("lines of one length fit into memory"));
    Ok(head.is_some().then(|| writer.into_inner().expect("memory can be flushed")))
}

/// The head and the records of a table. `None` if there is no such file.
fn read(path: &Path) -> Result<Option<(ByteRecord, ByteRecordsIntoIter<File>)>, GridError> {
    let file = match File::open(path) {
        Ok(file) => file,
        Err(why) if why.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(why) => return Err(GridError::io(path, why)),
    };
    let mut reader = csv::ReaderBuilder::new().flexible(true).from_reader(file);
    let head = reader.byte_headers().map_err(|why| GridError::io(path, why.into()))?.clone();
    Ok(Some((head, reader.into_byte_records())))
}

fn other_columns(path: &Path) -> GridError {
    GridError::OtherSetup(
        path.to_owned(),
        "its columns are those of another version or other groups".to_owned(),
    )
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
    gather(out, folders, &all.cells)?;
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
fn check_same(path: &Path, old: &Results, new: &Results) -> Result<(), GridError> {
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
            let [old, new] = [old, new].map(|results| labels::grid(&results.setup.grid));
            let why =
                format!("its {what} is {a}, and that of this command is {b}. There: {old}. Here: {new}");
            Err(GridError::OtherSetup(path.to_owned(), why))
        }
    }
}

/// Sorts the cells into the order of the grid.
pub(crate) fn sort(cells: &mut [Cell], points: &[Point]) {
    cells.sort_by_key(|cell| points.iter().position(|point| *point == cell.point).unwrap_or(usize::MAX));
}
