//! The steps of a frame before the detector: simulated sensor, then unwrapping or merging.

pub mod multi_exposure;
mod paper;
pub mod quality;
mod suite;

use std::sync::Arc;

use modulo_core::{Exposure, Frame, Sensor};
use modulo_msgs::std_msgs::Header;
use modulo_runtime::{Clock, NodeName, StampedFrame};
use ndarray::Array3;

use super::neighbours::FrameWithNeighbours;
use super::nodes::Nodes;
use super::{GridError, Request};
use crate::results::{Point, Protocol, Stream};
use multi_exposure::MultiExposurePipeline;
use paper::PaperPipeline;
use quality::RecoveryQuality;
use suite::SuitePipeline;

/// Bits of the simulated sensor.
pub const BITS: u8 = 8;

/// (stage, nanoseconds) in the order of the stages.
pub type Stages = Vec<(&'static str, u64)>;

/// The result of a pipeline for one frame.
#[derive(Default)]
pub struct DetectorInput {
    /// The image for the detector. `None` if a step gave no image.
    pub image: Option<Arc<StampedFrame>>,
    /// Duration of each step.
    pub stages: Stages,
    /// Quality of a recovered or merged image.
    pub recovery: Option<RecoveryQuality>,
}

/// Turns the frames of one cell into images for the detector. Each worker has its own.
pub type FramePipeline<'a> =
    Box<dyn FnMut(FrameWithNeighbours) -> Result<DetectorInput, GridError> + Send + 'a>;

/// The pipeline of the cell at `point`.
///
/// # Errors
/// [`GridError`] for an impossible parameter.
pub fn open<'a>(
    request: &Request,
    nodes: &'a dyn Nodes,
    timer: &'a dyn Clock,
    point: &Point,
) -> Result<FramePipeline<'a>, GridError> {
    let seed = request.options.seed;
    if request.options.protocol == Protocol::Paper {
        let mut pipeline = PaperPipeline::new(point, timer)?;
        return Ok(Box::new(move |frame| pipeline.run(&frame.frame)));
    }
    if matches!(point.stream, Stream::MultiExposure | Stream::MultiExposureStill) {
        let mut pipeline = MultiExposurePipeline::new(point, timer, seed)?;
        return Ok(Box::new(move |frame| pipeline.run(&frame)));
    }
    let mut pipeline = SuitePipeline::new(nodes, timer, point, seed)?;
    Ok(Box::new(move |frame| pipeline.run(frame.number, frame.frame)))
}

/// Time stamp of a frame for the nodes, ns: frames follow each other at 10 Hz, as in KITTI.
pub fn stamp(number: usize) -> u64 {
    number as u64 * 100_000_000
}

/// The name of a node in the root namespace. `name` is a valid ROS name.
pub fn node_name(name: &str) -> NodeName {
    NodeName { name: name.to_owned(), namespace: "/".to_owned(), remaps: Vec::new() }
}

fn unstamped(frame: Frame) -> Arc<StampedFrame> {
    Arc::new(StampedFrame { header: Header::default(), frame })
}

/// The true exposures that a recovered image is compared with: through the lens of the cell, and without a lens.
struct Truth([Sensor; 2]);

impl Truth {
    fn expose(&self, radiance: &Array3<f32>, seed: u64) -> Result<[Exposure; 2], GridError> {
        let [blurred, sharp] = &self.0;
        Ok([blurred.expose(radiance.view(), seed)?, sharp.expose(radiance.view(), seed)?])
    }
}
