//! [`Chain`]: the nodes that lead to cells, in lockstep, over frames that are handed to their camera one by one.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use modulo_bags::source::{ReadFrames, Source, SourceError, SourceFrame};
use modulo_camera::{CameraParameters, ModuloCamera};
use modulo_detector::{Detector, DetectorParameters, Sessions};
use modulo_runtime::clock::nanos;
use modulo_runtime::lockstep::{Lockstep, OnTopic};
use modulo_runtime::sensor_info::{self, SensorHistory};
use modulo_runtime::{Clock, Message, Node, SensorModel};
use modulo_unwrap::UnwrapNode;

use crate::GridError;
use crate::frames::HandedFrame;
use crate::makers::PublishedSpud;
use crate::plan::{CAMERA, Cell, DETECTOR, PlannedNode, UNWRAP};

/// Lowest score of a detection. AP needs detections of low confidence, too.
const LEAST_SCORE: f64 = 0.001;

/// The place through which a frame goes to a camera, or to a node in its place.
#[derive(Clone, Default)]
struct Handed(Arc<Mutex<Option<SourceFrame>>>);

impl Handed {
    fn place(&self) -> MutexGuard<'_, Option<SourceFrame>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ReadFrames for Handed {
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        self.place().take().map(Ok)
    }

    /// The frames before are not read here.
    fn pass(&mut self, _: u64) {}

    fn rewind(&mut self) {}
}

/// The nodes that lead to cells of one variant and camera.
pub struct Chain<'c> {
    lockstep: Lockstep<'c>,
    cells: &'c [&'c Cell<'c>],
    handed: Handed,
    /// The nodes behind the camera that are not in the chain yet.
    rest: Vec<&'c PlannedNode>,
    /// Seed of the noise of the first frame.
    pub seed: u64,
    interval: u64,
}

impl<'c> Chain<'c> {
    /// Makes the camera. `compares`: whether the images are compared with the true ones, which takes longer than most methods.
    pub fn new(cells: &'c [&'c Cell<'c>], timer: &'c dyn Clock, compares: bool) -> Result<Self, GridError> {
        let first = cells[0];
        let (nodes, member) = (first.nodes, first.stream.way[0]);
        let mut members: Vec<usize> = cells.iter().flat_map(|cell| cell.stream.way.iter().copied()).collect();
        members.sort_unstable();
        members.dedup();
        members.retain(|other| *other != member);
        let (handed, topics) = (Handed::default(), topics(cells, compares));
        let mut lockstep = Lockstep::new(timer, topics);
        lockstep.add(camera(first, &handed)?, &nodes[member].name)?;
        Ok(Self {
            lockstep,
            handed,
            rest: members.into_iter().map(|member| &nodes[member]).collect(),
            seed: first.sensing().seed.unsigned_abs(),
            interval: nanos(first.interval),
            cells,
        })
    }

    /// Whether frames before a slice have to go through all nodes, and not through the camera alone.
    pub fn needs_all(&self) -> bool {
        self.cells.iter().any(|cell| cell.stream.is_auto || cell.sensing().exposure)
    }

    /// Makes the nodes behind the camera, with detectors that share `sessions` and have this number of threads of an inference, or without
    /// detectors.
    pub fn complete(&mut self, sessions: Option<&Sessions>, threads: usize) -> Result<(), GridError> {
        for node in std::mem::take(&mut self.rest) {
            let made: Box<dyn Node> = match (node.executable, sessions) {
                (UNWRAP, _) => Box::new(UnwrapNode::new(&(&node.parameters).into())?),
                (DETECTOR, Some(sessions)) => {
                    Box::new(Detector::sharing(&detector(node, threads), sessions)?)
                }
                (DETECTOR, None) => continue,
                (other, _) => unreachable!("{other} is no node behind a camera"),
            };
            self.lockstep.add(made, &node.name)?;
        }
        Ok(())
    }

    /// Returns what the nodes send for a frame. A frame on its own has a camera of its own.
    pub fn tick(&mut self, frame: &HandedFrame, is_still: bool) -> Result<Vec<OnTopic>, GridError> {
        if is_still && self.cells.iter().any(|cell| cell.follows()) {
            self.lockstep.exchange(0, camera(self.cells[0], &self.handed)?);
        }
        // The noise depends on the place of the frame alone, so that it does not depend on the worker that gets the frame.
        self.lockstep.resume(0, frame.place as u64);
        *self.handed.place() = Some(frame.frame.clone());
        let out = self.lockstep.tick(0, frame.place as u64 * self.interval)?;
        Ok(out.unwrap_or_default())
    }

    /// Returns the durations of the stages of the last frame.
    pub fn stages(&self) -> &[(&'static str, u64)] {
        self.lockstep.stages()
    }

    /// Returns the status of the nodes.
    pub fn status(self) -> Vec<(String, String)> {
        self.lockstep.finish().into_iter().flat_map(|report| report.status).collect()
    }

    /// Returns the sensor of a frame: that of the parameters, with the exposure that the camera describes.
    pub fn sensor(&self, out: &[OnTopic]) -> SensorModel {
        let CameraParameters { sensor, exposure, .. } = self.cells[0].sensing();
        let mut described = SensorHistory::default();
        for (topic, message) in out.iter().filter(|_| exposure) {
            if let Message::Diagnostics(array) = message
                && sensor_info::is_topic(topic)
            {
                // A camera of the suite describes a sensor.
                let _ = described.note(array);
            }
        }
        let alpha = described.latest().map_or(sensor.alpha, |described| described.alpha);
        SensorModel { alpha, ..sensor }
    }
}

/// The parameters of a detector that gives boxes of low scores, too.
fn detector(node: &PlannedNode, threads: usize) -> DetectorParameters {
    DetectorParameters { score_threshold: LEAST_SCORE, threads, ..(&node.parameters).into() }
}

/// Makes a camera, or the node in its place, over the frames that come through `handed`.
fn camera(cell: &Cell<'_>, handed: &Handed) -> Result<Box<dyn Node>, GridError> {
    let parameters = CameraParameters { frames: 0, r#loop: false, ..cell.sensing() };
    Ok(match cell.camera().executable {
        CAMERA => Box::new(ModuloCamera::over(handed.clone(), &parameters)?),
        _ => Box::new(PublishedSpud::new(&parameters, Source::over(handed.clone()))?),
    })
}

/// The topics whose messages are needed of the cells of a chain.
fn topics(cells: &[&Cell<'_>], compares: bool) -> Vec<String> {
    let mut topics: Vec<String> = Vec::new();
    for Cell { stream, .. } in cells {
        topics.push(stream.detections.clone());
        // The last image of the cell, also of a camera without the nodes behind it.
        topics.push(stream.images.clone());
        if compares {
            topics.extend(stream.labels.clone());
            let (namespace, _) = stream.images.rsplit_once('/').unwrap_or_default();
            topics.push(format!("{namespace}/{}", sensor_info::TOPIC));
            let unwrapped = stream.unwrapped.iter();
            topics
                .extend(unwrapped.flat_map(|of| [&of.picture, &of.counts, &of.recovery].map(String::clone)));
        }
    }
    topics
}
