//! [`run`]: runs the cells one after the other and stores the results after each of them.

use modulo_ap::{average, difficulty};
use modulo_runtime::Clock;

use super::frames::Frames;
use super::pipeline::{Nodes, RECOVERY_DEFINITION, multi_exposure};
use super::runner::{Account, CellRunner, INSPECT, LOAD, OTHER, SCORE, STORE, TIMES};
use super::score::Scorer;
use super::{GridEvent, GridOptions, Request, timing};
use crate::classes::Table;
use crate::metric::{bootstrap, latency, paper};
use crate::results::{Point, Results};
use crate::{GridError, store};

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
    let GridOptions { axes, protocol, shard, fresh, .. } = &request.options;
    let mut account = Account::new(timer, request.jobs());
    let warn = |line: &String| tell(GridEvent::Warning(line));
    let points = axes.points(*protocol)?;
    multi_exposure::check(request, &points)?;
    axes.unused(*protocol, &points).iter().for_each(warn);
    let (map, groups) = (request.class_map()?, request.groups()?);
    let setup = request.setup(&map, &groups, &points)?;
    account.book(OTHER);
    let mut frames = Frames::inspect(&request.data, &request.source())?;
    account.book(INSPECT);
    // After the checks of the request, so that a wrong one makes no folder, and before the first cell.
    store::prepare(&request.out)?;
    let scorer = Scorer::new(request, map, groups, &mut frames)?;
    account.book(LOAD);
    // Few drives are no loss, so that this warning is not among those of the input.
    frames.input.warnings.iter().chain(&frames.input.interval_warning()).for_each(warn);
    let (input, definitions) = (frames.input.clone(), definitions());
    let empty = Results { setup, input, definitions, ..Results::default() };
    let mut results = store::resume(&request.out, *fresh, empty)?;
    results.runs.push(request.provenance.clone());
    let (done, todo): (Vec<&Point>, Vec<&Point>) = shard.of(&points).partition(|point| results.has(point));
    let others = results.cells.iter().filter(|cell| !points.contains(&cell.point)).count();
    tell(GridEvent::Resumed { cells: done.len(), others });
    let mut runner = CellRunner::new(request, nodes, timer);
    let each = frames.len() as u64;
    for (index, &point) in todo.iter().enumerate() {
        let name = point.to_string();
        tell(GridEvent::Cell { frames: (index as u64 * each, todo.len() as u64 * each), name: &name });
        account.book(OTHER);
        let found = runner.run(point, &mut frames, &mut account, &|| tell(GridEvent::Frame))?;
        let (cell, listing) = (scorer.cell(point.clone(), &found), scorer.listing(point, &found));
        account.book(SCORE);
        store::keep(&request.out, &mut results, cell, [&listing.frames, &listing.boxes])?;
        account.book(STORE);
    }
    drop(runner);
    timing::measure(request, nodes, timer, &mut frames, &mut results, tell)?;
    account.book(TIMES);
    store::gather(&request.out, std::slice::from_ref(&request.out), &results.cells)?;
    account.book(STORE);
    results.runs.last_mut().expect("this run was added").time = Some(account.finish());
    // A run without any cell to process writes its files, too.
    store::save(&request.out, &results)?;
    let unanswered = results.cells.iter().map(|cell| cell.unanswered).sum();
    let whole = points.iter().all(|point| results.has(point));
    Ok(GridOutcome { results, unanswered, whole })
}

/// The definition of each figure, by its name.
fn definitions() -> Table {
    [
        ("ap50", average::DEFINITION),
        ("ap50_95", "Mean over groups of the mean AP at the ten IoU thresholds 0.50, 0.55, ..., 0.95."),
        ("classes", "As ap50, for one class of the labels. Other classes of its group that the model cannot find are ignored."),
        ("difficulty", difficulty::DIFFICULTIES),
        ("exact_k, psnr_db, ssim", RECOVERY_DEFINITION),
        ("interval95", bootstrap::DEFINITION),
        ("latency_ms", latency::DEFINITION),
        ("paper", paper::DEFINITION),
    ]
    .map(|(name, text)| (name.to_owned(), text.split_whitespace().collect::<Vec<_>>().join(" ")))
    .into()
}
