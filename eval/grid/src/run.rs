//! [`Evaluation`]: runs the cells that a folder does not have yet, slice by slice, and scores what is there.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use modulo_runtime::Clock;

use crate::GridError;
use crate::data::DataOptions;
use crate::engine::{Engine, Unit, units};
use crate::feeds::{Feed, feeds};
use crate::frames::{Frames, Slice};
use crate::labels;
use crate::plan::{self, Cell, Variant};
use crate::progress::{GridEvent, Listener};
use crate::results::{Point, Results};
use crate::score::{self, ScoreOptions};
use crate::store::{Claim, Folder, digest};
use crate::timing::{self, Timing};
use crate::variants::Varied;

/// Number of frames of a slice. A run that is killed loses the slices that its threads are at.
const SLICE: usize = 100;
/// Time between two looks at what another process is at.
const PATIENCE: Duration = Duration::from_millis(200);

/// Everything that determines a run but the nodes, as options of a command line.
#[derive(Args, Clone, Debug, Default)]
pub struct Request {
    /// Values that a launch argument takes by turns, such as alpha=2,4,8, or a parameter of a node, such as unwrap.method=auto,spud
    /// (repeatable: every combination is evaluated)
    #[arg(long, value_name = "NAME=VALUES")]
    pub vary: Vec<Varied>,
    /// Frames to take, by their places from 0 on: FIRST:END, without END
    #[arg(long = "frames", value_name = "FIRST:END", value_parser = places)]
    pub places: Option<Range<usize>>,
    /// The frames.
    #[command(flatten)]
    pub data: DataOptions,
    /// Folder for the results, which may have some; without it a new one in runs
    #[arg(short, long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
    /// Number of frames that are processed in parallel. 0: one for each core
    #[arg(long, default_value_t = 0, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(..=1024))]
    pub jobs: usize,
    /// Remove the results that are in the folder
    #[arg(long)]
    pub fresh: bool,
    /// How the boxes are scored.
    #[command(flatten)]
    pub score: ScoreOptions,
    /// The times to measure.
    #[command(flatten)]
    pub timing: Timing,
}

/// Reads `FIRST:END`.
fn places(text: &str) -> Result<Range<usize>, String> {
    let parsed = text.split_once(':').and_then(|(first, end)| {
        let first = if first.is_empty() { 0 } else { first.parse().ok()? };
        let end = if end.is_empty() { usize::MAX } else { end.parse().ok()? };
        (first < end).then_some(first..end)
    });
    parsed.ok_or_else(|| "must be FIRST:END with FIRST below END, such as 0:250".to_owned())
}

/// The cells of a request, with their frames.
pub struct Evaluation<'a> {
    pub(crate) request: &'a Request,
    pub(crate) feeds: Vec<Feed<'a>>,
}

impl<'a> Evaluation<'a> {
    /// Looks at all streams, models and sources.
    ///
    /// # Errors
    /// [`GridError`] if one of them is not there, or the streams and frames do not fit each other.
    pub fn new(request: &'a Request, variants: &'a [Variant]) -> Result<Self, GridError> {
        let cells = plan::cells(variants)?;
        if cells.is_empty() {
            return Err(GridError::Request("no stream of the launch file is evaluated".to_owned()));
        }
        Ok(Self { request, feeds: feeds(cells, &request.data)? })
    }

    /// Runs the cells that are not finished yet on the frames of the request, stores the boxes of each cell and slice in the folder `out`,
    /// measures the times that are asked for, and returns the figures of all that is in the folder.
    ///
    /// # Errors
    /// [`GridError`] before the first cell if the folder holds other results; and later if a step fails or results cannot be written.
    pub fn run(
        &mut self,
        out: &Path,
        timer: &dyn Clock,
        listener: &Listener<'_>,
    ) -> Result<Results, GridError> {
        let folder = Folder::open(out, self.request.fresh)?;
        let cells = self.feeds.iter().flat_map(|feed| &feed.cells);
        let mut points: Vec<&Point> = cells.map(|cell| &cell.key.point).collect();
        points.sort_by(|a, b| a.order(b));
        folder.put_plan(&points)?;
        let jobs = match self.request.jobs {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            jobs => jobs,
        };
        let mut engine = Engine::new(timer, jobs);
        let places = self.request.places.clone().unwrap_or(0..usize::MAX);
        for Feed { name, frames, cells } in &mut self.feeds {
            let units = units(cells, frames.is_still);
            Work { folder: &folder, feed: name, units, listener }.run(&mut engine, frames, &places)?;
        }
        drop(engine);
        self.report(&folder, timer, listener)
    }

    /// Scores what is in the folder, and measures the times that are asked for.
    fn report(
        &mut self,
        folder: &Folder,
        timer: &dyn Clock,
        listener: &Listener<'_>,
    ) -> Result<Results, GridError> {
        let Self { request, feeds } = self;
        let score = || score::score(std::slice::from_ref(folder), &request.score);
        let is_timed = request.timing.time_frames > 0;
        // Another process that measures now would take the processor, and what it has measured is not measured again.
        let _claim = if is_timed { wait_for(folder, "times", listener)? } else { None };
        let results = score()?;
        let warnings = results.input.warnings.iter().cloned().chain(results.input.interval_warning());
        warnings.for_each(|line| (listener.tell)(GridEvent::Warning(&line)));
        let is_timed = is_timed && !(listener.stopped)();
        if !is_timed || !timing::measure(&request.timing, folder, timer, feeds, (&results, listener.tell))? {
            return Ok(results);
        }
        let results = score()?;
        labels::busy(&results.cells).iter().for_each(|line| (listener.tell)(GridEvent::Warning(line)));
        Ok(results)
    }
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
    units: Vec<Unit<'w>>,
    listener: &'w Listener<'w>,
}

/// Cells of which some frames are missing, and the places of these frames.
type Missing<'w> = Vec<(&'w Cell<'w>, Range<usize>)>;

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
            let slice = frames.inspect(first..end);
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
                let points: Vec<&Point> = unit.cells.iter().map(|cell| &cell.key.point).collect();
                let [first, end] = slice.places;
                let name = format!("{}.{first}-{end}", digest(&(self.feed, points)));
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

    /// The cells of a unit of which some frames of the slice are missing.
    fn missing(&self, unit: &Unit<'w>, slice: &Slice) -> Result<Missing<'w>, GridError> {
        let ([first, end], finished) = (slice.places, self.folder.finished()?);
        let missing = |cell: &&'w Cell<'w>| Some((*cell, cell.key.missing(&finished, &(first..end))?));
        Ok(unit.cells.iter().filter_map(missing).collect())
    }

    fn run_unit(
        &self,
        (unit, number, todo): (&Unit<'w>, usize, &Missing<'w>),
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
        let cells: Vec<&Cell<'_>> = todo.iter().map(|(cell, _)| *cell).collect();
        let streams: Vec<&str> = cells.iter().map(|cell| cell.stream.name.as_str()).collect();
        let name = format!("{}, alpha {}", streams.join(", "), cells[0].key.point.sensor.alpha);
        (self.listener.tell)(GridEvent::Cell { frames: (number as u64 * each, all * each), name: &name });
        let runs = engine.run((&cells, unit.is_ordered), (frames, &part), self.listener)?;
        let mut found = runs.iter().filter(|run| run.places[0] < run.places[1]);
        found.try_for_each(|run| self.folder.put_cell(run))
    }
}
