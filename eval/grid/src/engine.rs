//! [`Engine`]: the frames of a slice through the nodes of cells, in lockstep, on several threads.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::ScopedJoinHandle;

use modulo_detector::{EngineDevice, Sessions};
use modulo_runtime::Clock;

use crate::GridError;
use crate::chain::{Chain, follows, shared};
use crate::frames::{Frames, Slice, Walk};
use crate::handed::HandedFrame;
use crate::messages::{classes, found};
use crate::plan::Cell;
use crate::progress::{GridEvent, Listener};
use crate::quality::TrueExposures;
use crate::store::FrameFound;

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
        let is_ordered = cell.stream.is_auto || follows(cell) && !is_still;
        let fits = |unit: &&mut Unit<'a>| {
            let first = unit.cells[0];
            let is_same = std::ptr::eq(first.variant, cell.variant) && first.camera == cell.camera;
            unit.is_ordered == is_ordered && is_same && shared(first) == shared(cell)
        };
        match units.iter_mut().find(fits) {
            Some(unit) => unit.cells.push(cell),
            None => units.push(Unit { cells: vec![cell], is_ordered }),
        }
    }
    units
}

/// What a cell has found in a slice.
#[derive(Clone, Debug, Default)]
pub struct CellRun {
    /// The classes that the model knows.
    pub classes: Vec<String>,
    /// The frames; fewer where the run was stopped.
    pub frames: Vec<FrameFound>,
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

    /// Runs the frames of `slice` through the nodes of `cells`, which belong to one unit.
    ///
    /// # Errors
    /// [`GridError`] of a node that cannot be made or go on.
    pub fn run(
        &mut self,
        (cells, is_ordered): (&[&Cell<'_>], bool),
        (frames, slice): (&mut Frames, &Slice),
        listener: &Listener<'_>,
    ) -> Result<Vec<CellRun>, GridError> {
        let (_, session) = shared(cells[0]);
        if self.loaded.as_ref() != Some(&session) {
            // The old models are freed before the new ones are loaded, so that the memory never holds both.
            self.sessions.clear();
            self.sessions = sessions(&session[3], self.jobs);
            self.loaded = Some(session);
        }
        let is_still = frames.is_still();
        let work = Work {
            timer: self.timer,
            cells,
            is_still,
            is_ordered,
            listener,
            walk: Mutex::new(Walk::new(frames, slice, is_ordered)?),
            found: Mutex::new(vec![None; slice.frames.len()]),
            has_failed: AtomicBool::new(false),
        };
        // Frames that depend on each other are processed in their order, by one worker.
        let most = if is_ordered { 1 } else { usize::MAX };
        let known = std::thread::scope(|scope| {
            let work = &work;
            let start = |sessions| scope.spawn(move || work.run(sessions));
            let workers: Vec<_> = self.sessions.iter().take(most).map(start).collect();
            let join = |worker: ScopedJoinHandle<'_, _>| {
                worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            };
            let ended: Vec<_> = workers.into_iter().map(join).collect();
            ended.into_iter().collect::<Result<Vec<_>, _>>()
        })?;
        Ok(work.runs(&known))
    }
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
    /// What the cells have found in each frame.
    found: Mutex<Vec<Option<Vec<FrameFound>>>>,
    has_failed: AtomicBool,
}

impl Work<'_, '_> {
    /// Takes frames until there is none left. Returns the classes that the model of each cell knows.
    fn run(&self, sessions: &Sessions) -> Result<Vec<Vec<String>>, GridError> {
        let known = vec![Vec::new(); self.cells.len()];
        let mut worker =
            Worker { work: self, sessions, chain: None, drive: None, truth: TrueExposures::default(), known };
        let next = || self.walk.lock().unwrap_or_else(PoisonError::into_inner).next();
        while !(self.listener.stopped)()
            && !self.has_failed.load(Ordering::Relaxed)
            && let Some(frame) = next()
        {
            let passed = frame.map_err(GridError::from).and_then(|(index, frame)| worker.take(index, &frame));
            // The others end, too.
            passed.inspect_err(|_| self.has_failed.store(true, Ordering::Relaxed))?;
        }
        Ok(worker.known)
    }

    /// What each cell has found. Where the run was stopped, the frames before the first one that is missing are whole.
    fn runs(self, known: &[Vec<Vec<String>>]) -> Vec<CellRun> {
        let classes = |cell: usize| known.iter().map(|known| &known[cell]).find(|known| !known.is_empty());
        let run = |cell| CellRun { classes: classes(cell).cloned().unwrap_or_default(), frames: Vec::new() };
        let mut runs: Vec<CellRun> = (0..self.cells.len()).map(run).collect();
        let found = self.found.into_inner().unwrap_or_else(PoisonError::into_inner);
        for found in found.into_iter().map_while(|found| found) {
            runs.iter_mut().zip(found).for_each(|(run, found)| run.frames.push(found));
        }
        runs
    }
}

/// The cells of a unit on one thread.
struct Worker<'w, 'f> {
    work: &'w Work<'w, 'f>,
    sessions: &'w Sessions,
    chain: Option<Chain<'w>>,
    /// The drive of the chain.
    drive: Option<usize>,
    truth: TrueExposures,
    /// The classes that the model of each cell knows.
    known: Vec<Vec<String>>,
}

impl<'w> Worker<'w, '_> {
    /// Takes a frame, which has this index in the slice, or comes before it.
    fn take(&mut self, index: Option<usize>, frame: &HandedFrame) -> Result<(), GridError> {
        match index {
            Some(index) => {
                let found = self.run(frame)?;
                self.work.found.lock().unwrap_or_else(PoisonError::into_inner)[index] = Some(found);
                (self.work.listener.tell)(GridEvent::Frame);
                Ok(())
            }
            None => self.lead(frame),
        }
    }

    /// Takes the nodes, which are made anew where a drive begins that the images depend on.
    fn take_chain(&mut self, frame: &HandedFrame) -> Result<Chain<'w>, GridError> {
        let Work { timer, cells, is_ordered, .. } = self.work;
        let begins = self.drive.is_none_or(|drive| drive != frame.drive && *is_ordered);
        self.drive = Some(frame.drive);
        self.chain.take().filter(|_| !begins).map_or_else(|| Chain::new(cells, *timer, true), Ok)
    }

    /// Lets the nodes see a frame before the slice.
    fn lead(&mut self, frame: &HandedFrame) -> Result<(), GridError> {
        let mut chain = self.take_chain(frame)?;
        if chain.needs_all() {
            chain.complete(Some(self.sessions), THREADS)?;
        }
        chain.tick(frame, false)?;
        self.chain = Some(chain);
        Ok(())
    }

    /// Returns what each cell finds in a frame.
    fn run(&mut self, frame: &HandedFrame) -> Result<Vec<FrameFound>, GridError> {
        let mut chain = self.take_chain(frame)?;
        chain.complete(Some(self.sessions), THREADS)?;
        let out = chain.tick(frame, self.work.is_still)?;
        let sensor = chain.sensor(&out);
        let mut all = Vec::with_capacity(self.work.cells.len());
        for (cell, known) in self.work.cells.iter().zip(&mut self.known) {
            let recovery = self.truth.quality(cell, &out, (frame, &sensor, chain.seed))?;
            all.push(FrameFound {
                place: frame.place,
                boxes: found(&out, &cell.stream.detections),
                recovery,
            });
            if let Some(classes) = cell.stream.labels.as_ref().and_then(|topic| classes(&out, topic)) {
                *known = classes.into_iter().collect();
            }
        }
        self.chain = Some(chain);
        Ok(all)
    }
}
