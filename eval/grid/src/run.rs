//! [`run`]: runs the cells that a folder does not have yet, slice by slice, and scores what is there.

use std::ops::Range;
use std::path::PathBuf;
use std::time::Duration;

use modulo_runtime::Clock;

use crate::GridError;
use crate::data::Data;
use crate::engine::{Engine, Unit, units};
use crate::feeds::{Feed, feeds};
use crate::frames::{Frames, Slice};
use crate::labels;
use crate::models::{Models, models};
use crate::plan::{self, Cell, Variant};
use crate::progress::{GridEvent, Listener};
use crate::results::{Point, Results};
use crate::score::{self, ScoreOptions};
use crate::store::{CellKey, CellSlice, Claim, Folder, digest};
use crate::timing::{self, Timing};

/// Number of frames of a slice. A run that is killed loses the slices that its threads are at.
const SLICE: usize = 100;
/// Time between two looks at what another process is at.
const PATIENCE: Duration = Duration::from_millis(200);

/// Everything that determines a run.
#[derive(Clone, Debug)]
pub struct Request {
    /// The nodes, once for each combination of what varies.
    pub variants: Vec<Variant>,
    /// The frames. `None`: those of the cameras.
    pub data: Option<Data>,
    /// The frames to take, by their places.
    pub places: Range<usize>,
    /// Number of frames that are processed in parallel. 0: one for each core.
    pub jobs: usize,
    /// The times to measure.
    pub timing: Timing,
    /// How boxes are scored.
    pub score: ScoreOptions,
    /// Whether results that are there are removed.
    pub fresh: bool,
    /// Folder for the results.
    pub out: PathBuf,
}

/// Checks that the streams, models and frames of a request are there.
///
/// # Errors
/// Those of [`run`] before the first cell, but for those of its folder.
pub fn check(request: &Request) -> Result<(), GridError> {
    let cells = plan::cells(&request.variants)?;
    models(&cells)?;
    feeds(cells, request.data.as_ref()).map(drop)
}

/// Runs the cells that are not finished yet on the frames of the request, stores the boxes of each cell and slice, measures the times that
/// are asked for, and returns the figures of all that is in the folder.
///
/// # Errors
/// [`GridError`] before the first cell if the request is wrong, or the folder holds other results; and later if a step fails or results
/// cannot be written.
pub fn run(request: &Request, timer: &dyn Clock, listener: &Listener<'_>) -> Result<Results, GridError> {
    let cells = plan::cells(&request.variants)?;
    if cells.is_empty() {
        return Err(GridError::Request("no stream of the launch file is evaluated".to_owned()));
    }
    let models = models(&cells)?;
    let points: Vec<Point> = cells.iter().map(|cell| cell.point.clone()).collect();
    let mut feeds = feeds(cells, request.data.as_ref())?;
    // After the checks of the request, so that a wrong one makes no folder, and before the first cell.
    let folder = Folder::open(&request.out, request.fresh)?;
    folder.put_plan(&points)?;
    let jobs = match request.jobs {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        jobs => jobs,
    };
    let mut engine = Engine::new(timer, jobs);
    for feed in &mut feeds {
        let is_still = feed.frames.is_still();
        let work = Work {
            folder: &folder,
            feed: &feed.name,
            models: &models,
            units: units(&feed.cells, is_still),
            listener,
        };
        work.run(&mut engine, &mut feed.frames, &request.places)?;
    }
    drop(engine);
    report(request, &folder, timer, &mut feeds, listener)
}

/// Scores what is in the folder, and measures the times that are asked for.
fn report(
    request: &Request,
    folder: &Folder,
    timer: &dyn Clock,
    feeds: &mut [Feed<'_>],
    listener: &Listener<'_>,
) -> Result<Results, GridError> {
    let score = || score::score(std::slice::from_ref(folder), &request.score);
    let is_timed = request.timing.time_frames > 0;
    // Another process that measures now would take the processor, and what it has measured is not measured again.
    let _claim = if is_timed { wait_for(folder, "times", listener)? } else { None };
    let results = score()?;
    let warnings = results.input.warnings.iter().cloned().chain(results.input.interval_warning());
    warnings.for_each(|line| (listener.tell)(GridEvent::Warning(&line)));
    let is_timed = is_timed && !(listener.stopped)();
    let timed =
        is_timed && timing::measure(&request.timing, folder, timer, feeds, (&results, listener.tell))?;
    if !timed {
        return Ok(results);
    }
    let results = score()?;
    labels::busy(&results.cells).iter().for_each(|line| (listener.tell)(GridEvent::Warning(line)));
    Ok(results)
}

/// Waits for the right to work on something. `None` if the run is to stop.
fn wait_for(folder: &Folder, name: &str, listener: &Listener<'_>) -> Result<Option<Claim>, GridError> {
    while !(listener.stopped)() {
        if let Some(claim) = folder.claim(name)? {
            return Ok(Some(claim));
        }
        std::thread::sleep(PATIENCE);
    }
    Ok(None)
}

/// The cells of one camera in a folder.
struct Work<'w> {
    folder: &'w Folder,
    feed: &'w str,
    models: &'w Models,
    units: Vec<Unit<'w>>,
    listener: &'w Listener<'w>,
}

impl<'w> Work<'w> {
    /// Runs slice after slice.
    fn run(
        &self,
        engine: &mut Engine<'_>,
        frames: &mut Frames,
        places: &Range<usize>,
    ) -> Result<(), GridError> {
        let mut first = places.start;
        while first < places.end && !(self.listener.stopped)() {
            // Slices begin at the same places in each process.
            let end = ((first / SLICE + 1) * SLICE).min(places.end);
            let slice = frames.inspect(first..end)?;
            let [_, read] = slice.places;
            if let Some(why) = slice.nothing() {
                return Err(GridError::Results(why));
            }
            if read == places.start {
                let why = format!("there is no frame from number {read} on; --frames A:B counts from 0");
                return Err(GridError::Request(why));
            }
            if read > first {
                self.folder.put_frames(self.feed, &slice)?;
                self.finish(engine, frames, &slice)?;
            }
            if read < end {
                break;
            }
            first = end;
        }
        Ok(())
    }

    /// Runs all that is missing of a slice, and waits for what other processes are at.
    fn finish(&self, engine: &mut Engine<'_>, frames: &mut Frames, slice: &Slice) -> Result<(), GridError> {
        loop {
            let mut is_busy = false;
            for (number, unit) in self.units.iter().enumerate() {
                if (self.listener.stopped)() {
                    return Ok(());
                }
                if self.missing(unit, slice)?.is_empty() {
                    continue;
                }
                let name = format!("{}.{}-{}", self.name(unit), slice.places[0], slice.places[1]);
                let Some(_claim) = self.folder.claim(&name)? else {
                    is_busy = true;
                    continue;
                };
                // Another process may have finished it before this one had the right to.
                let todo = self.missing(unit, slice)?;
                if !todo.is_empty() {
                    self.run_unit((unit, number, &todo), engine, frames, slice)?;
                }
            }
            if !is_busy {
                return Ok(());
            }
            std::thread::sleep(PATIENCE);
        }
    }

    /// The name of the work on a unit.
    fn name(&self, unit: &Unit<'_>) -> String {
        let points: Vec<&Point> = unit.cells.iter().map(|cell| &cell.point).collect();
        digest(&(self.feed, points))
    }

    fn key(&self, cell: &Cell<'_>) -> CellKey {
        let (point, frames) = (cell.point.clone(), self.feed.to_owned());
        CellKey { model: self.models[&point.model].1.clone(), point, frames }
    }

    /// The cells of which some frames of the slice are missing, and the places of these frames.
    fn missing(
        &self,
        unit: &Unit<'w>,
        slice: &Slice,
    ) -> Result<Vec<(&'w Cell<'w>, Range<usize>)>, GridError> {
        let ([first, end], finished) = (slice.places, self.folder.finished()?);
        let missing = |cell: &&'w Cell<'w>| Some((*cell, self.key(cell).missing(&finished, &(first..end))?));
        Ok(unit.cells.iter().filter_map(missing).collect())
    }

    fn run_unit(
        &self,
        (unit, number, todo): (&Unit<'w>, usize, &[(&'w Cell<'w>, Range<usize>)]),
        engine: &mut Engine<'_>,
        frames: &mut Frames,
        slice: &Slice,
    ) -> Result<(), GridError> {
        let (first, end) = todo.iter().fold((usize::MAX, 0), |(first, end), (_, places)| {
            (first.min(places.start), end.max(places.end))
        });
        let mut part = Slice { places: [first, end], ..slice.clone() };
        part.frames.retain(|frame| (first..end).contains(&frame.place));
        let (each, all) = (slice.frames.len() as u64, self.units.len() as u64);
        let name = todo.iter().map(|(cell, _)| cell.point.stream.as_str()).collect::<Vec<_>>().join(", ");
        let name = format!("{name}, alpha {}", unit.cells[0].point.sensor.alpha);
        (self.listener.tell)(GridEvent::Cell { frames: (number as u64 * each, all * each), name: &name });
        let cells: Vec<&Cell<'_>> = todo.iter().map(|(cell, _)| *cell).collect();
        let runs = engine.run((&cells, unit.is_ordered), (frames, &part), self.listener)?;
        for (cell, run) in cells.into_iter().zip(runs) {
            // A run that was stopped has the frames before the first one that is missing.
            let end = part.frames.get(run.frames.len()).map_or(end, |next| next.place);
            if end > first {
                let slice = CellSlice {
                    key: self.key(cell),
                    classes: run.classes,
                    places: [first, end],
                    frames: run.frames,
                };
                self.folder.put_cell(&slice)?;
            }
        }
        Ok(())
    }
}
