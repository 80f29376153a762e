//! [`CellRunner`]: the frames of a cell through its pipeline and detector, on several threads.

use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};

use modulo_bags::source::SourceError;
use modulo_core::Detection;
use modulo_runtime::Clock;

use super::detect::{DetectionCache, DetectorConfig, DetectorWorker};
use super::frames::Frames;
use super::neighbours::{FrameWithNeighbours, FramesWithNeighbours};
use super::pipeline::Nodes;
use super::pipeline::{self, DetectorInput, FramePipeline, RecoveryQuality, multi_exposure};
use super::{GridError, Request};
use crate::results::Point;

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

    /// Runs all frames of the cell at `point` and calls `done` after each of them.
    pub fn run(
        &mut self,
        point: &Point,
        frames: &mut Frames,
        done: &(dyn Fn() + Sync),
    ) -> Result<Vec<FrameResult>, GridError> {
        self.load_detector(point)?;
        let pipelines = self.workers.iter().map(|_| self.pipeline(point)).collect::<Result<Vec<_>, _>>()?;
        let all = Mutex::new(vec![FrameResult::default(); frames.len()]);
        let frames = FramesWithNeighbours::new(frames, multi_exposure::neighbours(point.stream))?;
        // The channel is short, so that only a few frames are in memory: a frame has twelve bytes a pixel, and reading
        // is usually faster than the inference.
        let (send, receive) = sync_channel(self.workers.len() + 1);
        // Every worker shares the receiver. After the last worker has ended, sending fails instead of waiting for ever.
        let receive = Arc::new(Mutex::new(receive));
        let cache = &self.cache;
        std::thread::scope(|scope| {
            let workers: Vec<_> = pipelines
                .into_iter()
                .zip(&mut self.workers)
                .map(|(mut pipeline, worker)| {
                    let (all, receive) = (&all, receive.clone());
                    scope.spawn(move || -> Result<(), GridError> {
                        while let Some(frame) = next(&receive) {
                            let frame = frame?;
                            let number = frame.number;
                            let result = run_frame(&mut pipeline, worker, cache, frame)?;
                            all.lock().unwrap_or_else(PoisonError::into_inner)[number] = result;
                            done();
                        }
                        Ok(())
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
            workers.into_iter().try_for_each(|worker| match worker.join() {
                Ok(result) => result,
                Err(panic) => std::panic::resume_unwind(panic),
            })
        })?;
        Ok(all.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// The steps before the detector for the cell at `point`.
    pub fn pipeline(&self, point: &Point) -> Result<FramePipeline<'a>, GridError> {
        pipeline::open(self.request, self.nodes, self.timer, point)
    }

    /// Loads the detectors of the cell at `point`, if they differ from those of the cell before.
    pub fn load_detector(&mut self, point: &Point) -> Result<(), GridError> {
        let wanted = (point.model.clone(), point.input.clone());
        if self.loaded.as_ref() == Some(&wanted) {
            return Ok(());
        }
        let model = self.request.model(&point.model)?;
        // The cores are used by the jobs. The threads of the nodes are used where times are measured.
        let config =
            DetectorConfig { model, engine: self.request.options.engine, input: &point.input, threads: 1 };
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

fn run_frame(
    pipeline: &mut FramePipeline<'_>,
    worker: &mut DetectorWorker<'_>,
    cache: &DetectionCache,
    frame: FrameWithNeighbours,
) -> Result<FrameResult, GridError> {
    let number = frame.number;
    let DetectorInput { image, recovery, .. } = pipeline(frame)?;
    let Some(image) = image else { return Ok(FrameResult { found: None, recovery }) };
    let output = worker.detect(number, image, cache)?;
    Ok(FrameResult { found: output.found, recovery })
}
