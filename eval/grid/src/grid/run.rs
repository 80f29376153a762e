//! [`run`]: runs the cells one after the other and stores the results after each of them.

use modulo_ap::{average, difficulty};
use modulo_runtime::Clock;
use modulo_runtime::output::ResultFolder;

use super::frames::Frames;
use super::pipeline::{self, MakeDetector, RECOVERY_DEFINITION};
use super::runner::CellRunner;
use super::score::Scorer;
use super::{GridEvent, GridOptions, Request, timing};
use crate::classes::Table;
use crate::metric::{bootstrap, latency, paper};
use crate::results::{Point, RESULTS, Results};
use crate::{GridError, store};

/// Runs the cells that are not finished yet, and writes `results.json` and the lines of their frames into the
/// folder of the request after each of them. `timer` measures the stages.
///
/// # Errors
/// [`GridError`] before the first cell if the request is wrong, the folder holds results of another request, or no frame
/// can be scored; and later if a step fails or results cannot be written.
pub fn run(
    request: &Request,
    make: &MakeDetector,
    timer: &dyn Clock,
    tell: &(dyn Fn(GridEvent<'_>) + Sync),
) -> Result<Results, GridError> {
    let (GridOptions { axes, protocol, fresh, .. }, start) = (&request.options, timer.ticks_ns());
    let warn = |line: &String| tell(GridEvent::Warning(line));
    let points = axes.points(*protocol)?;
    pipeline::check(request, &points)?;
    axes.unused(*protocol, &points).iter().for_each(warn);
    let (map, groups) = (request.class_map()?, request.groups()?);
    let setup = request.setup(&map, &groups, &points)?;
    let mut frames = Frames::inspect(&request.data, &request.source())?;
    // After the checks of the request, so that a wrong one makes no folder, and before the first cell.
    let _folder = ResultFolder::take(Some(&request.out), "eval", Some(RESULTS))
        .map_err(|why| GridError::Request(why.to_string()))?;
    let scorer = Scorer::new(request, map, groups, &mut frames)?;
    // Few drives are no loss, so that this warning is not among those of the input.
    frames.input.warnings.iter().chain(&frames.input.interval_warning()).for_each(warn);
    let found = Results { setup, input: frames.input.clone(), ..Results::default() };
    let mut results = store::resume(&request.out, *fresh, Results { definitions: definitions(), ..found })?;
    results.runs.push(request.provenance.clone());
    let (done, todo): (Vec<&Point>, Vec<&Point>) = points.iter().partition(|point| results.has(point));
    found_there(done.len(), results.others(&points)).iter().for_each(warn);
    let (each, mut runner) = (frames.len() as u64, CellRunner::new(request, make, timer));
    for (index, &point) in todo.iter().enumerate() {
        let frames_of_all = (index as u64 * each, todo.len() as u64 * each);
        tell(GridEvent::Cell { frames: frames_of_all, name: &point.to_string() });
        let found = runner.run(point, &mut frames, &|| tell(GridEvent::Frame))?;
        store::keep(&request.out, &mut results, scorer.cell(point.clone(), &found), &scorer.listing(&found))?;
    }
    drop(runner);
    timing::measure(request, make, timer, &mut frames, &mut results, tell)?;
    let wall_s = timer.ticks_ns().saturating_sub(start) as f64 / 1e9;
    results.runs.last_mut().expect("this run was added").wall_s = Some(wall_s);
    // A run without any cell to process writes its files, too.
    store::save(&request.out, &results)?;
    Ok(results)
}

/// Returns what is to be said of cells that were in the folder before.
fn found_there(finished: usize, others: usize) -> Vec<String> {
    let finished = (finished > 0).then(|| format!("{finished} cells are finished already"));
    let others = (others > 0).then(|| format!("{others} cells of other grids are in the folder and stay"));
    finished.into_iter().chain(others).collect()
}

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
