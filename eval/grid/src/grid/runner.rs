//! [`CellRunner`]: the frames of a cell through its pipeline and detector, on several threads. [`Account`]: where the wall
//! time of a run goes.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::ScopedJoinHandle;

use modulo_bags::source::SourceError;
use modulo_core::Detection;
use modulo_runtime::Clock;

use super::detect::{DetectionCache, DetectorConfig, DetectorOutput, DetectorWorker};
use super::frames::{FrameWithNeighbours, Frames, FramesWithNeighbours};
use super::pipeline::{DetectorInput, FramePipeline, Nodes, RecoveryQuality, multi_exposure};
use super::{GridError, GridOptions, Request, pipeline};
use crate::results::{Point, RunTime};

/// The result of one frame of one cell.
#[derive(Clone, Debug, Default)]
pub struct FrameResult {
    /// Detections by descending score. `None` if no answer came.
    pub found: Option<Arc<Vec<Detection>>>,
    /// Quality of a recovered image.
    pub recovery: Option<RecoveryQuality>,
}

/// Runs cells one after the other. It keeps the detectors and their cache while the model and its input size stay.
pub struct CellRunner<'a> {
    request: &'a Request,
    nodes: &'a dyn Nodes,
    timer: &'a dyn Clock,
    /// One detector for each job.
    pub workers: Vec<DetectorWorker<'a>>,
    cache: DetectionCache,
    /// Model and input size of the workers.
    loaded: Option<(String, String)>,
}

impl<'a> CellRunner<'a> {
    /// A runner that has not loaded a detector yet.
    pub fn new(request: &'a Request, nodes: &'a dyn Nodes, timer: &'a dyn Clock) -> Self {
        Self { request, nodes, timer, workers: Vec::new(), cache: DetectionCache::default(), loaded: None }
    }

    /// Runs all frames of the cell at `point` and calls `done` after each of them. Adds the time of the workers to `account`.
    pub fn run(
        &mut self,
        point: &Point,
        frames: &mut Frames,
        account: &mut Account<'_>,
        done: &(dyn Fn() + Sync),
    ) -> Result<Vec<FrameResult>, GridError> {
        self.load_detector(point)?;
        account.book(LOAD);
        let pipelines =
            self.workers.iter().map(|_| self.pipeline(point, true)).collect::<Result<Vec<_>, _>>()?;
        let all = Mutex::new(vec![FrameResult::default(); frames.len()]);
        let frames = FramesWithNeighbours::new(frames, multi_exposure::neighbours(point.stream))?;
        // The channel is short, so that only a few frames are in memory: a frame has twelve bytes a pixel, and reading
        // is usually faster than the inference.
        let (send, receive) = sync_channel(self.workers.len() + 1);
        // Every worker shares the receiver. After the last worker has ended, sending fails instead of waiting for ever.
        let receive = Arc::new(Mutex::new(receive));
        account.book(OTHER);
        let (cache, timer, start) = (&self.cache, self.timer, self.timer.ticks_ns());
        let spent = std::thread::scope(|scope| {
            let workers: Vec<_> = pipelines
                .into_iter()
                .zip(&mut self.workers)
                .map(|(mut pipeline, worker)| {
                    let (all, receive) = (&all, receive.clone());
                    scope.spawn(move || -> Result<(Spent, u64), GridError> {
                        let (mut spent, mut since) = (Spent::new(), start);
                        while let Some(frame) = next(&receive) {
                            *spent.entry(WAIT).or_default() += timer.ticks_ns().saturating_sub(since);
                            let frame = frame?;
                            let number = frame.number;
                            let result = run_frame(&mut pipeline, worker, cache, frame, &mut spent)?;
                            all.lock().unwrap_or_else(PoisonError::into_inner)[number] = result;
                            done();
                            since = timer.ticks_ns();
                        }
                        Ok((spent, since))
                    })
                })
                .collect();
            drop(receive);
            // This thread reads ahead while the workers compute.
            for frame in frames {
                if send.send(frame).is_err() {
                    break;
                }
            }
            drop(send);
            // A worker that fails ends alone, and the others go on with the remaining frames. Its error is reported
            // here.
            let join = |worker: ScopedJoinHandle<'_, _>| match worker.join() {
                Ok(result) => result,
                Err(panic) => std::panic::resume_unwind(panic),
            };
            workers.into_iter().map(join).collect::<Result<Vec<(Spent, u64)>, GridError>>()
        })?;
        // A worker without a further frame waits until the last worker is ready.
        let end = timer.ticks_ns();
        for (mut spent, since) in spent {
            *spent.entry(WAIT).or_default() += end.saturating_sub(since);
            account.add(&spent, end);
        }
        Ok(all.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// The steps before the detector for the cell at `point`, see [`pipeline::open`].
    pub fn pipeline(&self, point: &Point, compares: bool) -> Result<FramePipeline<'a>, GridError> {
        pipeline::open(self.request, self.nodes, self.timer, point, compares)
    }

    /// Loads the detectors of the cell at `point`, if they differ from those of the cell before.
    pub fn load_detector(&mut self, point: &Point) -> Result<(), GridError> {
        let wanted = (point.model.clone(), point.input.clone());
        if self.loaded.as_ref() == Some(&wanted) {
            return Ok(());
        }
        let model = self.request.model(&point.model)?;
        // The cores are used by the jobs. The threads of the nodes are used where times are measured.
        let GridOptions { engine, device, .. } = self.request.options;
        let config = DetectorConfig { model, engine, device, input: &point.input, threads: 1 };
        // The old models are freed before the new ones are loaded, so that the memory never holds both.
        self.workers.clear();
        for _ in 0..self.request.jobs() {
            self.workers.push(DetectorWorker::open(self.nodes, self.timer, &config)?);
        }
        self.cache = DetectionCache::default();
        self.loaded = Some(wanted);
        Ok(())
    }
}

type Read = Result<FrameWithNeighbours, SourceError>;

fn next(receive: &Mutex<Receiver<Read>>) -> Option<Read> {
    receive.lock().unwrap_or_else(PoisonError::into_inner).recv().ok()
}

/// Runs one frame, and adds its stages to `spent`.
fn run_frame(
    pipeline: &mut FramePipeline<'_>,
    worker: &mut DetectorWorker<'_>,
    cache: &DetectionCache,
    frame: FrameWithNeighbours,
    spent: &mut Spent,
) -> Result<FrameResult, GridError> {
    let number = frame.number;
    let DetectorInput { image, recovery, stages, compare_ns } = pipeline(frame)?;
    let output = match image {
        Some(image) => worker.detect(number, image, cache)?,
        None => DetectorOutput::default(),
    };
    let stages = stages.into_iter().chain(output.stages).chain([(COMPARE, compare_ns)]);
    stages.for_each(|(stage, ns)| *spent.entry(stage).or_default() += ns);
    Ok(FrameResult { found: output.found, recovery })
}

/// Durations by stage, ns.
pub type Spent = BTreeMap<&'static str, u64>;

/// The stages of a run that are no stages of a frame: reading all frames once, loading models, waiting for the thread that
/// reads the frames, comparing a recovered image with the true one, scoring, writing results, and measuring times.
pub const INSPECT: &str = "inspect";
pub const LOAD: &str = "load";
pub const WAIT: &str = "wait";
pub const COMPARE: &str = "compare";
pub const SCORE: &str = "score";
pub const STORE: &str = "store";
pub const TIMES: &str = "times";
/// All between the other stages.
pub const OTHER: &str = "other";

/// The wall time of a run so far, by stage.
pub struct Account<'a> {
    timer: &'a dyn Clock,
    start: u64,
    /// The end of the last stage.
    booked: u64,
    workers: usize,
    stages_ns: BTreeMap<&'static str, f64>,
}

impl<'a> Account<'a> {
    /// Begins the account of a run with `workers` workers.
    pub fn new(timer: &'a dyn Clock, workers: usize) -> Self {
        let start = timer.ticks_ns();
        Self { timer, start, booked: start, workers, stages_ns: BTreeMap::new() }
    }

    /// Books the time since the last stage, in which all workers waited, as a stage that ends now.
    pub fn book(&mut self, stage: &'static str) {
        let now = self.timer.ticks_ns();
        *self.stages_ns.entry(stage).or_default() += now.saturating_sub(self.booked) as f64;
        self.booked = now;
    }

    /// Adds the durations of one worker until `end`.
    pub fn add(&mut self, spent: &Spent, end: u64) {
        self.booked = end;
        for (stage, ns) in spent {
            *self.stages_ns.entry(stage).or_default() += *ns as f64 / self.workers as f64;
        }
    }

    /// The wall time since the start. What no stage has is added to [`OTHER`].
    pub fn finish(&self) -> RunTime {
        let wall = self.timer.ticks_ns().saturating_sub(self.start) as f64;
        let mut stages_ns = self.stages_ns.clone();
        *stages_ns.entry(OTHER).or_default() += wall - self.stages_ns.values().sum::<f64>();
        let stages_s = stages_ns.into_iter().map(|(stage, ns)| (stage.to_owned(), ns / 1e9)).collect();
        RunTime { wall_s: wall / 1e9, workers: self.workers, stages_s }
    }
}
