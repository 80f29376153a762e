//! [`Engine`]: the frames of a slice through the nodes of cells, in lockstep, on several threads.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::ScopedJoinHandle;

use modulo_detector::{EngineDevice, Sessions};
use modulo_runtime::Clock;

use crate::GridError;
use crate::chain::Chain;
use crate::frames::{Frames, HandedFrame, Slice, Walk};
use crate::messages::{classes, found};
use crate::plan::Cell;
use crate::progress::{GridEvent, Listener};
use crate::quality::TrueExposures;
use crate::store::{CellSlice, FrameFound};

/// Threads of one inference: the jobs use the cores.
const THREADS: usize = 1;
/// Inputs of the network whose outputs are remembered: those of the streams and methods of one frame.
const REMEMBERED: usize = 8;

/// Cells that go through the nodes together: those of one variant, camera and model.
pub struct Unit<'a> {
    /// The cells.
    pub cells: Vec<&'a Cell<'a>>,
    /// Whether an image or its boxes depend on the frames before it.
    pub is_ordered: bool,
}

/// Groups cells, of which those of one model come in a row. The frames of `is_still` data do not follow each other.
pub fn units<'a>(cells: &'a [Cell<'a>], is_still: bool) -> Vec<Unit<'a>> {
    let mut units: Vec<Unit<'a>> = Vec::new();
    for cell in cells {
        let is_ordered = cell.stream.is_auto || cell.follows() && !is_still;
        let fits = |unit: &&mut Unit<'a>| {
            let first = unit.cells[0];
            let is_same = std::ptr::eq(first.nodes, cell.nodes) && first.stream.way[0] == cell.stream.way[0];
            unit.is_ordered == is_ordered && is_same && first.session() == cell.session()
        };
        match units.iter_mut().find(fits) {
            Some(unit) => unit.cells.push(cell),
            None => units.push(Unit { cells: vec![cell], is_ordered }),
        }
    }
    units
}

/// Runs units one after the other. It keeps the sessions of the detector while its model and input size stay.
pub struct Engine<'a> {
    timer: &'a dyn Clock,
    /// Those of each job.
    sessions: Vec<Sessions>,
    /// The model, input size, engine and device of the sessions.
    loaded: Option<[String; 4]>,
    jobs: usize,
}

impl<'a> Engine<'a> {
    /// An engine with this number of threads that has not loaded a model yet.
    pub fn new(timer: &'a dyn Clock, jobs: usize) -> Self {
        Self { timer, sessions: Vec::new(), loaded: None, jobs }
    }

    /// Returns what each of `cells`, which belong to one unit, finds in the frames of `slice`. Where the run was stopped, it ends before the
    /// first frame that is missing.
    pub fn run(
        &mut self,
        (cells, is_ordered): (&[&Cell<'_>], bool),
        (frames, slice): (&mut Frames, &Slice),
        listener: &Listener<'_>,
    ) -> Result<Vec<CellSlice>, GridError> {
        let session = cells[0].session();
        if self.loaded.as_ref() != Some(&session) {
            // The old models are freed before the new ones are loaded, so that the memory never holds both.
            self.sessions.clear();
            self.sessions = sessions(&session[3], self.jobs);
            self.loaded = Some(session);
        }
        let is_still = frames.is_still;
        let walk = Mutex::new(Walk::new(frames, slice, is_ordered));
        let has_failed = AtomicBool::new(false);
        let work = Work { timer: self.timer, cells, is_still, is_ordered, listener, walk, has_failed };
        // Frames that depend on each other are processed in their order, by one worker.
        let most = if is_ordered { 1 } else { usize::MAX };
        let workers = std::thread::scope(|scope| {
            let work = &work;
            let start = |sessions| scope.spawn(move || Worker::new(work, sessions).run());
            let workers: Vec<_> = self.sessions.iter().take(most).map(start).collect();
            let join = |worker: ScopedJoinHandle<'_, _>| {
                worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            };
            let ended: Vec<_> = workers.into_iter().map(join).collect();
            ended.into_iter().collect::<Result<Vec<_>, _>>()
        })?;
        Ok(joined(cells, slice, workers))
    }
}

/// Joins what workers have found, up to the first frame that is missing.
fn joined(cells: &[&Cell<'_>], slice: &Slice, workers: Vec<Done>) -> Vec<CellSlice> {
    let run =
        |cell: &&Cell<'_>| CellSlice { key: cell.key.clone(), places: slice.places, ..CellSlice::default() };
    let mut runs: Vec<CellSlice> = cells.iter().map(run).collect();
    let mut found = BTreeMap::new();
    for Done { classes, found: own } in workers {
        let known = runs.iter_mut().zip(classes).filter(|(_, classes)| !classes.is_empty());
        known.for_each(|(run, classes)| run.classes = classes);
        found.extend(own);
    }
    for (index, record) in slice.frames.iter().enumerate() {
        let Some(found) = found.remove(&index) else {
            runs.iter_mut().for_each(|run| run.places[1] = record.place);
            break;
        };
        runs.iter_mut().zip(found).for_each(|(run, found)| run.frames.push(found));
    }
    runs
}

/// Sessions for this number of threads: a thread of the processor runs a model of its own, and a GPU runs one, by turns.
fn sessions(device: &str, jobs: usize) -> Vec<Sessions> {
    if device.parse() == Ok(EngineDevice::Cpu) {
        return std::iter::repeat_with(|| Sessions::remembering(REMEMBERED)).take(jobs).collect();
    }
    vec![Sessions::remembering(REMEMBERED * jobs); jobs]
}

/// What the threads of a unit share.
struct Work<'w, 'f> {
    timer: &'w dyn Clock,
    cells: &'w [&'w Cell<'w>],
    is_still: bool,
    is_ordered: bool,
    listener: &'w Listener<'w>,
    /// A thread reads its next frame while the others compute, so that few frames are in memory: a frame has twelve bytes a pixel.
    walk: Mutex<Walk<'f>>,
    has_failed: AtomicBool,
}

/// The findings of a thread.
struct Done {
    /// The classes that the model of each cell knows.
    classes: Vec<Vec<String>>,
    /// The findings of all cells in a frame, by the index of the frame in the slice.
    found: BTreeMap<usize, Vec<FrameFound>>,
}

/// The cells of a unit on one thread.
struct Worker<'w, 'f> {
    work: &'w Work<'w, 'f>,
    sessions: &'w Sessions,
    chain: Option<Chain<'w>>,
    /// The drive of the chain.
    drive: Option<usize>,
    truth: TrueExposures,
    done: Done,
}

impl<'w, 'f> Worker<'w, 'f> {
    fn new(work: &'w Work<'w, 'f>, sessions: &'w Sessions) -> Self {
        let done = Done { classes: vec![Vec::new(); work.cells.len()], found: BTreeMap::new() };
        Self { work, sessions, chain: None, drive: None, truth: TrueExposures::default(), done }
    }

    /// Takes frames until there is none left.
    fn run(mut self) -> Result<Done, GridError> {
        let Work { listener, walk, has_failed, .. } = self.work;
        let next = || walk.lock().unwrap_or_else(PoisonError::into_inner).next();
        while !(listener.stopped)()
            && !has_failed.load(Ordering::Relaxed)
            && let Some(frame) = next()
        {
            let passed = frame.map_err(GridError::from).and_then(|(index, frame)| self.take(index, &frame));
            // The others end, too.
            passed.inspect_err(|_| has_failed.store(true, Ordering::Relaxed))?;
        }
        Ok(self.done)
    }

    /// Takes a frame, which has this index in the slice, or comes before it: then the nodes only see it.
    fn take(&mut self, index: Option<usize>, frame: &HandedFrame) -> Result<(), GridError> {
        let Work { timer, cells, is_ordered, is_still, listener, .. } = self.work;
        // The nodes are made anew where a drive begins that the images depend on.
        if *is_ordered && self.drive != Some(frame.drive) {
            self.chain = None;
        }
        self.drive = Some(frame.drive);
        let chain = match &mut self.chain {
            Some(chain) => chain,
            None => self.chain.insert(Chain::new(cells, *timer, true)?),
        };
        if index.is_some() || chain.needs_all() {
            chain.complete(Some(self.sessions), THREADS)?;
        }
        let out = chain.tick(frame, *is_still && index.is_some())?;
        let Some(index) = index else { return Ok(()) };
        let (sensor, place) = (chain.sensor(&out), frame.place);
        let mut all = Vec::with_capacity(cells.len());
        for (cell, known) in cells.iter().zip(&mut self.done.classes) {
            let recovery = self.truth.quality(cell, &out, (frame, &sensor, chain.seed))?;
            all.push(FrameFound { place, boxes: found(&out, &cell.stream.detections), recovery });
            if let Some(classes) = cell.stream.labels.as_ref().and_then(|topic| classes(&out, topic)) {
                *known = classes.into_iter().collect();
            }
        }
        self.done.found.insert(index, all);
        (listener.tell)(GridEvent::Frame);
        Ok(())
    }
}
