//! [`run`]: runs the cells one after the other and stores the results after each of them.

use std::path::Path;

use modulo_runtime::Clock;

use super::frames::Frames;
use super::nodes::Nodes;
use super::pipeline::multi_exposure;
use super::runner::CellRunner;
use super::score::Scorer;
use super::{GridError, Request, merge, setup};
use crate::metric::bootstrap::Units;
use crate::results::{Point, RESULTS, Results};
use crate::store;

/// Progress of a grid run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event<'a> {
    /// The folder already holds some of the cells.
    Resumed {
        /// Number of these cells.
        cells: usize,
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
pub struct Outcome {
    /// The results as they are in the folder.
    pub results: Results,
    /// Number of frames without an answer, over all cells.
    pub unanswered: usize,
}

impl Outcome {
    /// Whether frames, labels or answers are missing.
    pub fn lost(&self) -> bool {
        self.unanswered > 0 || !self.results.input.warnings.is_empty()
    }
}

/// Runs the cells that are not finished yet, and writes `results.json` and `results.csv` into the folder of the request
/// after each of them. `timer` measures the stages.
///
/// # Errors
/// [`GridError`] before the first cell if the request is wrong, the folder holds results of another request, or no frame
/// can be scored; and later if a step fails or results cannot be written.
pub fn run(
    request: &Request,
    nodes: &dyn Nodes,
    timer: &dyn Clock,
    tell: &(dyn Fn(Event<'_>) + Sync),
) -> Result<Outcome, GridError> {
    let points = request.options.axes.points(request.options.protocol)?;
    multi_exposure::check(request, &points)?;
    let (map, groups) = (request.class_map()?, request.groups()?);
    let setup = setup::setup(request, &map, &groups, &points)?;
    let mut frames = Frames::inspect(&request.data)?;
    frames.input.warnings.iter().for_each(|warning| tell(Event::Warning(warning)));
    let mapped = setup::mapped_classes(request, &map, &mut frames)?;
    let units = Units::new(&frames.drive_of, request.options.seed);
    let definitions = setup::definitions();
    let fresh = Results { setup, input: frames.input.clone(), definitions, cells: Vec::new() };
    let mut results = if request.options.fresh { fresh } else { resume(&request.out, fresh)? };
    let mine = points.iter().enumerate().filter(|(index, _)| request.options.shard.has(*index));
    let (done, todo): (Vec<&Point>, Vec<&Point>) = mine
        .map(|(_, point)| point)
        .partition(|point| results.cells.iter().any(|cell| cell.point == **point));
    tell(Event::Resumed { cells: done.len() });
    let mut runner = CellRunner::new(request, nodes, timer);
    let truths = frames.truths.clone();
    let each = frames.len() as u64;
    for (index, point) in todo.iter().enumerate() {
        let name = point.to_string();
        tell(Event::Cell { frames: (index as u64 * each, todo.len() as u64 * each), name: &name });
        let frames = runner.run(point, &mut frames, &|| tell(Event::Frame))?;
        let scorer = Scorer {
            truths: &truths,
            map: &map,
            groups: &groups,
            mapped: &mapped[&point.model],
            difficulty: request.difficulty(),
            units: &units,
        };
        results.cells.push(scorer.cell((*point).clone(), &frames, runner.device()));
        merge::sort(&mut results.cells, &points);
        store::save(&request.out, &results)?;
    }
    // A run without any cell to process writes its files, too.
    store::save(&request.out, &results)?;
    let unanswered = results.cells.iter().map(|cell| cell.unanswered).sum();
    Ok(Outcome { results, unanswered })
}

/// The results in the folder, if they belong to the same request, else `fresh`.
fn resume(folder: &Path, fresh: Results) -> Result<Results, GridError> {
    let Some(old) = store::load(folder)? else { return Ok(fresh) };
    merge::check_same(&folder.join(RESULTS), &old, &fresh)?;
    let cells = old.cells.into_iter().filter(|cell| fresh.setup.grid.contains(&cell.point)).collect();
    Ok(Results { cells, ..fresh })
}
