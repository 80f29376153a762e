//! [`run`]: runs the cells one after the other and stores the results after each of them, with the settings, definitions
//! and classes that all cells share.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use modulo_detector::{EngineOptions, describe};
use modulo_runtime::Clock;
use sha2::{Digest, Sha256};

use super::frames::Frames;
use super::listing::Listing;
use super::pipeline::Nodes;
use super::pipeline::{BITS, RECOVERY_DEFINITION, multi_exposure};
use super::runner::CellRunner;
use super::runner::{Account, INSPECT, LOAD, SCORE, STORE, TIMES};
use super::score::Scorer;
use super::{Axes, GridOptions, Request, timing};
use crate::classes::{ClassGroups, ClassMap, Table, of_labels};
use crate::metric::bootstrap::Units;
use crate::metric::{average, bootstrap, latency, matching, paper};
use crate::results::{BOXES, Cell, FIGURES, FRAMES, Input, Point, RESULTS, Results, Setup};
use crate::{GridError, labels, store};

/// Progress of a grid run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GridEvent<'a> {
    /// The folder already holds cells, all of which stay.
    Resumed {
        /// Number of the cells that this run would process.
        cells: usize,
        /// Number of the cells of other grids.
        others: usize,
    },
    /// A cell begins.
    Cell {
        /// Number of processed frames, and of all frames, over all cells of this run.
        frames: (u64, u64),
        /// Description of the cell.
        name: &'a str,
    },
    /// A frame of the cell is finished.
    Frame,
    /// A problem that does not end the run.
    Warning(&'a str),
}

/// Result of a grid run.
#[derive(Clone, Debug, PartialEq)]
pub struct GridOutcome {
    /// The results as they are in the folder.
    pub results: Results,
    /// Number of frames without an answer, over all cells.
    pub unanswered: usize,
    /// Whether all cells of the request are finished, over all shards.
    pub whole: bool,
}

impl GridOutcome {
    /// Whether frames, labels or answers are missing.
    pub fn lost(&self) -> bool {
        self.unanswered > 0 || self.results.lost()
    }
}

/// Runs the cells that are not finished yet, and writes `results.json`, `results.csv`, `frames.csv` and `boxes.csv` into the
/// folder of the request after each of them. `timer` measures the stages.
///
/// # Errors
/// [`GridError`] before the first cell if the request is wrong, the folder holds results of another request, or no frame
/// can be scored; and later if a step fails or results cannot be written.
pub fn run(
    request: &Request,
    nodes: &dyn Nodes,
    timer: &dyn Clock,
    tell: &(dyn Fn(GridEvent<'_>) + Sync),
) -> Result<GridOutcome, GridError> {
    let mut account = Account::new(timer, request.jobs());
    let points = request.options.axes.points(request.options.protocol)?;
    multi_exposure::check(request, &points)?;
    tell_unused(request, &points, tell);
    let (map, groups) = (request.class_map()?, request.groups()?);
    let setup = setup(request, &map, &groups, &points)?;
    let mut frames = account.stage(INSPECT, || Frames::inspect(&request.data, request.options.white))?;
    // After the checks of the request, so that a wrong one makes no folder, and before the first cell.
    store::prepare(&request.out)?;
    frames.input.warnings.extend(groups.unnamed(frames.truths.iter().flatten()));
    let units = Units::new(&frames.drive_of, request.options.seed);
    frames.input.drawn = Some(units.drawn());
    // Few drives are no loss, so that this warning is not among those of the input.
    let warnings = frames.input.warnings.iter().cloned().chain(frames.input.interval_warning());
    warnings.for_each(|warning| tell(GridEvent::Warning(&warning)));
    // The models are opened before the first cell, so that a wrong file ends the run now and not after hours.
    let mapped = account.stage(LOAD, || mapped_classes(request, &map, &mut frames))?;
    let (input, definitions) = (frames.input.clone(), definitions());
    let mut results = resume(request, Results { setup, input, definitions, ..Results::default() })?;
    let (names, truths, drives) = (frames.names.clone(), frames.truths.clone(), frames.drive_of.clone());
    let scorer = |point: &Point| Scorer {
        names: &names,
        drives: &drives,
        truths: &truths,
        map: &map,
        groups: &groups,
        mapped: &mapped[&point.model],
        difficulty: request.difficulty(),
        units: &units,
    };
    let todo = todo(request, &points, &results, tell);
    let mut runner = CellRunner::new(request, nodes, timer);
    let each = frames.len() as u64;
    for (index, point) in todo.iter().enumerate() {
        let name = point.to_string();
        tell(GridEvent::Cell { frames: (index as u64 * each, todo.len() as u64 * each), name: &name });
        let found = runner.run(point, &mut frames, &mut account, &|| tell(GridEvent::Frame))?;
        let scorer = scorer(point);
        let (cell, listing) =
            account.stage(SCORE, || (scorer.cell((*point).clone(), &found), scorer.listing(point, &found)));
        account.stage(STORE, || keep(request, &mut results, cell, &listing))?;
    }
    drop(runner);
    account.stage(TIMES, || measure_times(request, nodes, timer, &mut frames, &mut results, tell))?;
    account.stage(STORE, || gather(request, &results.cells))?;
    results.runs.last_mut().expect("resume adds this run").time = Some(account.finish());
    // A run without any cell to process writes its files, too.
    store::save(&request.out, &results)?;
    let unanswered = results.cells.iter().map(|cell| cell.unanswered).sum();
    let whole = points.iter().all(|point| results.cells.iter().any(|cell| cell.point == *point));
    Ok(GridOutcome { results, unanswered, whole })
}

/// Names the options that no cell has.
fn tell_unused(request: &Request, points: &[Point], tell: &(dyn Fn(GridEvent<'_>) + Sync)) {
    let GridOptions { axes, protocol, .. } = &request.options;
    let without = axes.without_cells(*protocol, points);
    let without =
        (!without.is_empty()).then(|| format!("these combinations have no cell: {}", without.join("; ")));
    without.iter().chain(&axes.unused_method()).for_each(|line| tell(GridEvent::Warning(line)));
}

/// The cells of this shard that are not finished yet.
fn todo<'a>(
    request: &Request,
    points: &'a [Point],
    results: &Results,
    tell: &(dyn Fn(GridEvent<'_>) + Sync),
) -> Vec<&'a Point> {
    // Shards take every n-th cell: models and inputs vary slowest, so that blocks would give one shard all the slow
    // models.
    let mine = points.iter().enumerate().filter(|(index, _)| request.options.shard.has(*index));
    let (done, todo): (Vec<&Point>, Vec<&Point>) = mine
        .map(|(_, point)| point)
        .partition(|point| results.cells.iter().any(|cell| cell.point == **point));
    let others = results.cells.iter().filter(|cell| !points.contains(&cell.point)).count();
    tell(GridEvent::Resumed { cells: done.len(), others });
    todo
}

/// Stores a finished cell with its lines.
fn keep(request: &Request, results: &mut Results, cell: Cell, listing: &Listing) -> Result<(), GridError> {
    // The lines come first: a cell without lines would never be run again.
    store::append(&request.out, FRAMES, &listing.frames)?;
    store::append(&request.out, BOXES, &listing.boxes)?;
    results.cells.push(cell);
    // Cells of an earlier run may come later in the grid.
    store::sort(&mut results.cells, &results.setup.grid);
    store::save(&request.out, results)
}

/// Leaves only the lines of `cells` in the tables of frames and boxes, in the order of `cells`.
fn gather(request: &Request, cells: &[Cell]) -> Result<(), GridError> {
    store::gather(&request.out, std::slice::from_ref(&request.out), cells)
}

/// The results in the folder with the cells of `fresh`, or `fresh` alone if there are none. Adds this run.
///
/// # Errors
/// [`GridError::OtherSetup`] if the cells of both cannot be shown together; the folder stays as it is.
fn resume(request: &Request, fresh: Results) -> Result<Results, GridError> {
    let folder = &request.out;
    let old = if request.options.fresh { None } else { store::load(folder)? };
    let mut results = match old {
        Some(old) => {
            store::check_same(&folder.join(RESULTS), &old, &fresh)?;
            joined(old, fresh)
        }
        None => fresh,
    };
    // Lines of cells that were not finished are left out: these cells are run again.
    gather(request, &results.cells)?;
    results.runs.push(request.provenance.clone());
    Ok(results)
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
    store::sort(&mut cells, &grid);
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

/// Measures the times of the cells anew if some of them have none or were measured in another pass. Cells whose models this
/// request does not have keep their times.
fn measure_times(
    request: &Request,
    nodes: &dyn Nodes,
    timer: &dyn Clock,
    frames: &mut Frames,
    results: &mut Results,
    tell: &(dyn Fn(GridEvent<'_>) + Sync),
) -> Result<(), GridError> {
    fn detector(cell: &Cell) -> (&str, &str) {
        (&cell.point.model, &cell.point.input)
    }
    let pass = |cell: &Cell| cell.frame_ms.as_ref().map(|time| time.pass.clone());
    // Only the models of this request are at hand.
    let (mut cells, others): (Vec<Cell>, Vec<Cell>) = std::mem::take(&mut results.cells)
        .into_iter()
        .partition(|cell| request.model(&cell.point.model).is_ok());
    let measured = cells.first().is_none_or(|first| pass(first).is_some())
        && cells.iter().all(|cell| pass(cell) == pass(&cells[0]));
    // Cells of earlier grids may stand between those of one detector.
    cells.sort_by(|a, b| detector(a).cmp(&detector(b)));
    let mut timed = Ok(());
    if !measured && request.options.time_frames > 0 {
        let frames_of_cell = request.options.time_frames.min(frames.len()) as u64;
        tell(GridEvent::Cell { frames: (0, cells.len() as u64 * frames_of_cell), name: "times" });
        timed = timing::measure(request, nodes, timer, frames, &mut cells, &|| tell(GridEvent::Frame));
        labels::busy(&cells).iter().for_each(|warning| tell(GridEvent::Warning(warning)));
    }
    cells.extend(others);
    store::sort(&mut cells, &results.setup.grid);
    results.cells = cells;
    timed
}

/// The setup of `request` with the cells at `points`. Reads the files of the models.
fn setup(
    request: &Request,
    map: &ClassMap,
    groups: &ClassGroups,
    points: &[Point],
) -> Result<Setup, GridError> {
    let options = &request.options;
    let model = |path: &PathBuf| Ok((Axes::model_name(path), sha256(path)?));
    Ok(Setup {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        figures: FIGURES,
        protocol: options.protocol,
        source: request.data.name(),
        bits: BITS,
        seed: options.seed,
        difficulty: request.difficulty(),
        engine: options.engine.to_string(),
        class_map: map.table.clone(),
        groups: groups.table().clone(),
        models: options.axes.model.iter().map(model).collect::<Result<_, GridError>>()?,
        grid: points.to_vec(),
    })
}

fn sha256(model: &Path) -> Result<String, GridError> {
    let bytes = match modulo_detector::embedded(model) {
        Some(bytes) => bytes.to_vec(),
        None => std::fs::read(model).map_err(|why| GridError::io(model, why))?,
    };
    Ok(modulo_models::hex(&Sha256::digest(bytes)))
}

/// The definition of each figure, by its name.
fn definitions() -> Table {
    [
        ("ap50", average::DEFINITION),
        ("ap50_95", "Mean over groups of the mean AP at the ten IoU thresholds 0.50, 0.55, ..., 0.95."),
        ("classes", "As ap50, for one class of the labels. Other classes of its group that the model cannot find are ignored."),
        ("difficulty", matching::DIFFICULTIES),
        ("exact_k, psnr_db, ssim", RECOVERY_DEFINITION),
        ("interval95", bootstrap::DEFINITION),
        ("latency_ms", latency::DEFINITION),
        ("paper", paper::DEFINITION),
    ]
    .map(|(name, text)| (name.to_owned(), text.split_whitespace().collect::<Vec<_>>().join(" ")))
    .into()
}

/// For each model the classes of the labels that it can find.
type MappedClasses = BTreeMap<String, BTreeSet<String>>;

/// Finds the mapped classes of each model, and notes in `frames.input` the classes without a counterpart.
fn mapped_classes(
    request: &Request,
    map: &ClassMap,
    frames: &mut Frames,
) -> Result<MappedClasses, GridError> {
    let labels: BTreeSet<String> =
        of_labels(frames.truths.iter().flatten()).into_iter().map(str::to_owned).collect();
    let mut all = MappedClasses::new();
    for model in &request.options.axes.model {
        let name = Axes::model_name(model);
        let own = describe(model, EngineOptions::on_cpu(request.options.engine, 1))?.classes;
        let found: BTreeSet<String> =
            own.iter().filter_map(|class| map.mapped(class)).map(str::to_owned).collect();
        // A model without class names may find every class.
        let mapped =
            if own.is_empty() { labels.clone() } else { labels.intersection(&found).cloned().collect() };
        let without = &mut frames.input.without_twin;
        without.insert(format!("labels, for {name}"), labels.difference(&mapped).cloned().collect());
        without.insert(name.clone(), own.into_iter().filter(|class| map.mapped(class).is_none()).collect());
        all.insert(name, mapped);
    }
    Ok(all)
}
