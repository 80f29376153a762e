//! [`run`]: cell after cell, results after each.

use std::collections::BTreeSet;
use std::path::Path;

use modulo_runtime::Clock;

use super::chain::Chain;
use super::exposures::{self, Exposures};
use super::eye::{Eye, Lens, Memory};
use super::frames::Frames;
use super::nodes::Nodes;
use super::paper::PaperWay;
use super::score::Scorer;
use super::seen::{Way, look_at_all};
use super::{Axes, Event, GridError, Outcome, Request, setup};
use crate::metric::bootstrap::Units;
use crate::results::{Cell, Device, Point, Protocol, Results, Stream};
use crate::store;

/// Works on the cells that are not done yet, and writes `results.json` and `results.csv` into the request's folder
/// after each. `timer` measures stages.
///
/// # Errors
/// [`GridError`] before anything is done when the request is wrong, the folder holds results of another one or no
/// frame can be scored; and when a step cannot go on or results cannot be written.
pub fn run(
    request: &Request,
    nodes: &dyn Nodes,
    timer: &dyn Clock,
    tell: &(dyn Fn(Event<'_>) + Sync),
) -> Result<Outcome, GridError> {
    let points = request.axes.points(request.protocol)?;
    exposures::check(request, &points)?;
    let map = setup::class_map(request);
    let setup = setup::setup(request, &map, &points)?;
    let mut frames = Frames::inspect(&request.data)?;
    frames.input.warnings.iter().for_each(|warning| tell(Event::Warning(warning)));
    let twins = setup::twins(request, &map, &mut frames)?;
    let units = Units::new(&frames.drive_of, request.seed);
    let difficulty = setup.difficulty;
    let definitions = setup::definitions();
    let fresh = Results { setup, input: frames.input.clone(), definitions, cells: Vec::new() };
    let mut results = resume(&request.out, fresh)?;
    let is_done = |results: &Results, point: &Point| results.cells.iter().any(|cell| cell.point == *point);
    let mine = points.iter().enumerate().filter(|(index, _)| request.shard.has(*index)).map(|(_, p)| p);
    let todo: Vec<&Point> = mine.clone().filter(|point| !is_done(&results, point)).collect();
    tell(Event::Resumed { cells: mine.count() - todo.len() });
    let mut workshop = Workshop::new(request, nodes, timer);
    let truths = frames.truths.clone();
    let (each, no_class) = (frames.len() as u64, BTreeSet::new());
    for (index, point) in todo.iter().enumerate() {
        let name = point.to_string();
        tell(Event::Cell { frames: (index as u64 * each, todo.len() as u64 * each), name: &name });
        let seen = workshop.work(point, &mut frames, &|| tell(Event::Frame))?;
        let scorer = Scorer {
            truths: &truths,
            map: &map,
            groups: &request.groups,
            twins: twins.get(&point.model).unwrap_or(&no_class),
            difficulty,
            units: &units,
        };
        results.cells.push(scorer.cell((*point).clone(), &seen, workshop.device()));
        sort(&mut results.cells, &points);
        store::save(&request.out, &results)?;
    }
    // A run that has nothing left to do leaves its files all the same.
    store::save(&request.out, &results)?;
    let unanswered = results.cells.iter().map(|cell| cell.unanswered).sum();
    Ok(Outcome { results, unanswered })
}

/// What was done before, if it was done for the same.
fn resume(folder: &Path, fresh: Results) -> Result<Results, GridError> {
    let Some(old) = store::load(folder)? else { return Ok(fresh) };
    super::merge::same(&folder.join(crate::results::RESULTS), &old, &fresh)?;
    let cells = old.cells.into_iter().filter(|cell| fresh.setup.grid.contains(&cell.point)).collect();
    Ok(Results { cells, ..fresh })
}

/// In the order of the grid, whatever the order in which they were done.
pub fn sort(cells: &mut [Cell], points: &[Point]) {
    cells.sort_by_key(|cell| points.iter().position(|point| *point == cell.point).unwrap_or(usize::MAX));
}

/// Detectors and what they remember, kept from cell to cell.
pub struct Workshop<'a> {
    request: &'a Request,
    nodes: &'a dyn Nodes,
    timer: &'a dyn Clock,
    /// One a worker.
    pub eyes: Vec<Eye<'a>>,
    memory: Memory,
    lens: Option<(String, String)>,
}

impl<'a> Workshop<'a> {
    /// Without a detector.
    pub fn new(request: &'a Request, nodes: &'a dyn Nodes, timer: &'a dyn Clock) -> Self {
        Self { request, nodes, timer, eyes: Vec::new(), memory: Memory::default(), lens: None }
    }

    fn work(
        &mut self,
        point: &Point,
        frames: &mut Frames,
        done: &(dyn Fn() + Sync),
    ) -> Result<Vec<super::seen::Seen>, GridError> {
        self.open_eyes(point)?;
        let ways = (0..self.eyes.len()).map(|_| self.way(point)).collect::<Result<Vec<_>, _>>()?;
        let neighbours = exposures::neighbours(point.stream);
        look_at_all((frames, neighbours), ways, &mut self.eyes, &self.memory, done)
    }

    /// The way of a frame to the detector of a cell.
    ///
    /// # Errors
    /// [`GridError`] for a parameter that is not possible.
    pub fn way(&self, point: &Point) -> Result<Way<'a>, GridError> {
        if self.request.protocol == Protocol::Paper {
            let mut way = PaperWay::new(point, self.timer)?;
            return Ok(Box::new(move |moment| way.pass(&moment.frame)));
        }
        if matches!(point.stream, Stream::MultiExposure | Stream::MultiExposureStill) {
            let mut way = Exposures::new(point, self.timer, self.request.seed)?;
            return Ok(Box::new(move |moment| way.pass(&moment)));
        }
        let mut chain = Chain::new(self.nodes, self.timer, point, self.request.seed)?;
        Ok(Box::new(move |moment| chain.pass(moment.number, moment.frame)))
    }

    /// The detectors of a cell; other ones only where the model or its input size changes.
    ///
    /// # Errors
    /// [`GridError`] for a model that does not run.
    pub fn open_eyes(&mut self, point: &Point) -> Result<(), GridError> {
        let wanted = (point.model.clone(), point.input.clone());
        if self.lens.as_ref() == Some(&wanted) {
            return Ok(());
        }
        let model = self.request.axes.models.iter().find(|path| Axes::model_name(path) == point.model);
        let model = model.ok_or(GridError::Empty("the list of models"))?;
        let Request { engine, threads, jobs, .. } = self.request;
        let lens = Lens { model, engine: *engine, input: &point.input, threads: *threads };
        self.eyes.clear();
        for _ in 0..*jobs {
            self.eyes.push(Eye::open(self.nodes, self.timer, &lens)?);
        }
        self.memory = Memory::default();
        self.lens = Some(wanted);
        Ok(())
    }

    fn device(&self) -> Device {
        Device {
            processor: self.request.processor.clone(),
            engine: self.eyes.first().map(|eye| eye.engine.clone()).unwrap_or_default(),
            threads: self.request.threads,
            jobs: self.request.jobs,
        }
    }
}
