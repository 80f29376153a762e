//! [`pipeline`]: the images of a normal camera whose exposure follows the frames before them.

use super::{DetectorInput, FramePipeline, PipelineConfig, Stages, timed, unstamped};
use crate::GridError;
use crate::grid::Request;
use crate::grid::frames::FrameWithNeighbours;
use crate::results::Point;

/// The camera of the cell at `point`. It needs all frames in their order. Each drive, and each image that belongs to no drive, starts with the
/// exposure of a camera that has looked at its first frame for long.
pub fn pipeline<'a>(
    request: &Request,
    point: &Point,
    config: PipelineConfig<'a>,
) -> Result<FramePipeline<'a>, GridError> {
    let fresh = point.sensor.auto_exposure()?;
    let is_still = request.data.is_still();
    let mut camera = (0, fresh.clone());
    Ok(Box::new(move |FrameWithNeighbours { number, drive, frame, .. }| {
        if is_still || camera.0 != drive {
            camera = (drive, fresh.clone());
        }
        let (mut stages, seed) = (Stages::new(), config.seed.wrapping_add(number as u64));
        let image =
            timed(config.timer, &mut stages, "sense", || camera.1.expose(frame.radiance.view(), seed))?;
        Ok(DetectorInput { image: Some(unstamped(image)), stages, ..DetectorInput::default() })
    }))
}
