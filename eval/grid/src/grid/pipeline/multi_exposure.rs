//! [`MultiExposurePipeline`]: three captures with different exposure times, merged as a normal camera does for a high
//! dynamic range.
//!
//! The captures are three consecutive frames of the drive with the longest exposure last; the middle one is the frame
//! that is scored. Moving objects leave ghosts: the captures are not aligned.

use modulo_core::{Bracket, Range, Sensor, SensorConfig, Transfer, tone};
use ndarray::Array3;

use super::{DetectorInput, FrameWithNeighbours, PipelineConfig, RecoveryQuality, Truth, unstamped};
use crate::GridError;
use crate::grid::frames::Neighbours;
use crate::grid::{Data, Request};
use crate::results::{Point, Protocol, Stream};

/// Number of captures that are merged.
pub const CAPTURES: usize = 3;

/// Whether the frames of a stream need the frames before and after them.
pub fn neighbours(stream: Stream) -> Neighbours {
    if stream == Stream::MultiExposure { Neighbours::Kept } else { Neighbours::Dropped }
}

/// Refuses merged captures under the protocol of the paper, and of moving scenes where the frames of the data are not
/// consecutive.
pub fn check(request: &Request, points: &[Point]) -> Result<(), GridError> {
    let refuse = |possible| Err(GridError::value("stream", "multi_exposure", possible));
    let has = |stream| points.iter().any(|point| point.stream == stream);
    let moving = has(Stream::MultiExposure);
    if (moving || has(Stream::MultiExposureStill)) && request.options.protocol == Protocol::Paper {
        return refuse("one of the other streams under the protocol of the paper");
    }
    match request.data {
        Data::Kitti { .. } | Data::Yolo(_) | Data::Coco { .. } if moving => refuse(
            "multi_exposure_still, because these frames are not consecutive; use --sequence or --source otherwise",
        ),
        _ => Ok(()),
    }
}

/// The captures and the merging of one cell.
pub struct MultiExposurePipeline<'a> {
    bracket: Bracket,
    /// One sensor for each capture.
    sensors: Vec<Sensor>,
    truth: Truth,
    range: Range,
    transfer: Transfer,
    config: PipelineConfig<'a>,
}

impl<'a> MultiExposurePipeline<'a> {
    /// The pipeline of the cell at `point`.
    pub fn new(point: &Point, config: PipelineConfig<'a>) -> Result<Self, GridError> {
        let (range, sensor) = (point.sensor.range()?, point.sensor.config()?);
        let bracket = Bracket::new(range, CAPTURES);
        // An exposure of a fraction of the time sees that fraction of the light: alpha is multiplied by the time.
        let of_time = |time: &f32| {
            let alpha = sensor.alpha * f64::from(*time);
            // Captures are merged before they are shown.
            Sensor::new(SensorConfig { alpha, transfer: Transfer::Linear, ..sensor })
        };
        let sensors = bracket.times().iter().map(of_time).collect::<Result<_, _>>()?;
        let truth = Truth::of(sensor)?;
        Ok(Self { bracket, sensors, truth, range, transfer: sensor.transfer, config })
    }

    /// Processes one frame.
    pub fn run(
        &mut self,
        FrameWithNeighbours { number, frame, around }: &FrameWithNeighbours,
    ) -> Result<DetectorInput, GridError> {
        let now = &frame.radiance;
        // The scene of the scored frame is in the middle, so that the ghosts lie on both sides of a moving object.
        let scenes: [&Array3<f32>; CAPTURES] = match around {
            Some([before, after]) => [before, now, after],
            None => [now; CAPTURES],
        };
        let PipelineConfig { timer, seed, .. } = self.config;
        let seed = seed.wrapping_add(*number as u64);
        let start = timer.ticks_ns();
        let mut captures = Vec::with_capacity(CAPTURES);
        for (index, (sensor, scene)) in self.sensors.iter().zip(scenes).enumerate() {
            // Each capture has its own noise. The upper bits keep its seed apart from those of the following frames.
            let seed = seed.wrapping_add((index as u64) << 48);
            captures.push(sensor.expose(scene.view(), seed)?.saturated());
        }
        let sensed = timer.ticks_ns();
        let x = self.bracket.merge(&captures)?;
        let merged = timer.ticks_ns();
        let image = tone::picture(&x, self.range, self.transfer).map_err(modulo_core::SensorError::from)?;
        let toned = timer.ticks_ns();
        let stages = vec![
            ("sense", sensed.saturating_sub(start)),
            ("merge", merged.saturating_sub(sensed)),
            ("tone", toned.saturating_sub(merged)),
        ];
        let image = unstamped(image);
        let mut input = DetectorInput { image: Some(image.clone()), stages, ..DetectorInput::default() };
        self.truth.compare(self.config, (now, seed), &mut input, |truth| {
            RecoveryQuality::of_merged(&image.frame, truth)
        })?;
        Ok(input)
    }
}
