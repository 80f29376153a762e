//! [`CellRunner`]: the frames of a cell through its pipeline and detector, on several threads.

use std::sync::{Mutex, PoisonError};
use std::thread::ScopedJoinHandle;

use modulo_runtime::Clock;

use super::detect::{DetectionCache, DetectorWorker, Found};
use super::frames::{Frames, FramesWithNeighbours};
use super::pipeline::{DetectorInput, FramePipeline, MakeDetector, RecoveryQuality};
use super::{GridError, Request, pipeline};
use crate::results::{Point, Stream};

#[derive(Clone, Debug, Default)]
pub struct FrameResult {
    pub found: Found,
    pub recovery: Option<RecoveryQuality>,
}

/// Runs cells one after the other. It keeps the detectors and their cache while the model and its input size stay.
pub struct CellRunner<'a> {
    request: &'a Request,
    make: &'a MakeDetector,
    timer: &'a dyn Clock,
    /// One detector for each job.
    pub workers: Vec<DetectorWorker<'a>>,
    cache: DetectionCache,
    /// Model and input size of the workers.
    loaded: Option<(String, String)>,
}

impl<'a> CellRunner<'a> {
    /// A runner that has not loaded a detector yet.
    pub fn new(request: &'a Request, make: &'a MakeDetector, timer: &'a dyn Clock) -> Self {
        Self { request, make, timer, workers: Vec::new(), cache: DetectionCache::default(), loaded: None }
    }

    /// Runs all frames of the cell at `point` and calls `done` after each of them.
    pub fn run(
        &mut self,
        point: &Point,
        frames: &mut Frames,
        done: &(dyn Fn() + Sync),
    ) -> Result<Vec<FrameResult>, GridError> {
        self.load_detector(point)?;
        let all = Mutex::new(vec![FrameResult::default(); frames.len()]);
        // A worker reads its next frame while the others compute, so that few frames are in memory: a frame has twelve
        // bytes a pixel.
        let frames = Mutex::new(FramesWithNeighbours::new(frames, point.stream == Stream::MultiExposure)?);
        let open = |worker| Ok((pipeline::open(self.request, self.timer, point, true)?, worker));
        // Frames that depend on each other are processed in their order, by one worker.
        let most = if point.stream.follows_frames() { 1 } else { usize::MAX };
        let workers = self.workers.iter_mut().take(most).map(open).collect::<Result<Vec<_>, GridError>>()?;
        let cache = &self.cache;
        std::thread::scope(|scope| {
            let work = |(mut pipeline, worker): (FramePipeline<'a>, &mut DetectorWorker<'a>)| {
                let next = || frames.lock().unwrap_or_else(PoisonError::into_inner).next();
                while let Some(frame) = next() {
                    let frame = frame?;
                    let number = frame.number;
                    let DetectorInput { image, recovery, .. } = pipeline(frame)?;
                    let found = image.map(|image| worker.detect(number, image, cache)).transpose()?.flatten();
                    let result = FrameResult { found, recovery };
                    all.lock().unwrap_or_else(PoisonError::into_inner)[number] = result;
                    done();
                }
                Ok::<(), GridError>(())
            };
            let workers: Vec<_> =
                workers.into_iter().map(|worker| scope.spawn(move || work(worker))).collect();
            // A worker that fails ends alone, and the others go on with the remaining frames. Its error is reported here.
            let join = |worker: ScopedJoinHandle<'_, _>| {
                worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            };
            workers.into_iter().try_for_each(join)
        })?;
        Ok(all.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// Loads the detectors of the cell at `point`, if they differ from those of the cell before.
    pub fn load_detector(&mut self, point: &Point) -> Result<(), GridError> {
        let wanted = (point.model.clone(), point.input.clone());
        if self.loaded.as_ref() == Some(&wanted) {
            return Ok(());
        }
        // The old models are freed before the new ones are loaded, so that the memory never holds both.
        self.workers.clear();
        for _ in 0..self.request.jobs() {
            // The cores are used by the jobs. The threads of the nodes are used where times are measured.
            self.workers.push(DetectorWorker::open(self.request, self.make, self.timer, point, 1)?);
        }
        self.cache = DetectionCache::default();
        self.loaded = Some(wanted);
        Ok(())
    }
}
