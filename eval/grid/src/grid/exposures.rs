//! [`Exposures`]: what a normal camera does for high dynamic range, three captures merged.
//!
//! The captures are three frames of the drive that follow each other, the middle
//! one being the frame that is scored, the longest exposure last. Whatever moves
//! in between has its ghosts; nothing here aligns or removes them.

use std::sync::Arc;

use modulo_core::{Bracket, Psf, Range, Sensor, SensorConfig, tone};
use modulo_msgs::std_msgs::Header;
use modulo_runtime::{Clock, StampedFrame};
use ndarray::Array3;

use super::chain::Passed;
use super::moment::{Moment, Neighbours};
use super::recovery::Recovery;
use super::{BITS, GridError, Request};
use crate::data::Data;
use crate::results::{Point, Protocol, Stream};

/// Captures that are merged.
pub const CAPTURES: usize = 3;

/// Whether frames of a stream need what is around them.
pub fn neighbours(stream: Stream) -> Neighbours {
    if stream == Stream::MultiExposure { Neighbours::Kept } else { Neighbours::Dropped }
}

/// Refuses captures that cannot follow each other.
///
/// # Errors
/// [`GridError::Value`] for the paper's protocol, and for data whose frames are not those of a drive.
pub fn check(request: &Request, points: &[Point]) -> Result<(), GridError> {
    let refuse = |possible: &str| {
        let value = "multi_exposure".to_owned();
        Err(GridError::Value { what: "stream", value, possible: possible.to_owned() })
    };
    let has = |stream| points.iter().any(|point| point.stream == stream);
    let moving = has(Stream::MultiExposure);
    if (moving || has(Stream::MultiExposureStill)) && request.protocol == Protocol::Paper {
        return refuse("one of the other streams under the paper's protocol");
    }
    match request.data {
        Data::Kitti { .. } | Data::Yolo(_) | Data::Coco { .. } if moving => {
            refuse("multi_exposure_still, for these frames do not follow each other; --sequence or --source")
        }
        _ => Ok(()),
    }
}

/// The steps of one cell.
pub struct Exposures<'a> {
    bracket: Bracket,
    /// One a capture.
    sensors: Vec<Sensor>,
    /// The truth's: with the cell's lens, and without.
    truth: [Sensor; 2],
    range: Range,
    seed: u64,
    timer: &'a dyn Clock,
}

impl<'a> Exposures<'a> {
    /// For one cell.
    ///
    /// # Errors
    /// [`GridError::Sensor`] for a sensor that is not possible.
    pub fn new(point: &Point, timer: &'a dyn Clock, seed: u64) -> Result<Self, GridError> {
        let range = Range::new(BITS, point.alpha).map_err(modulo_core::SensorError::from)?;
        let bracket = Bracket::new(range, CAPTURES);
        let sensor = |time: f64, psf_sigma: f64| {
            Sensor::new(SensorConfig {
                bits: BITS,
                alpha: point.alpha * time,
                psf: Psf::of_sigma(psf_sigma),
                read_noise: point.noise,
                shot_noise: 0.0,
            })
        };
        let of_time = |time: &f32| sensor(f64::from(*time), point.psf_sigma);
        let sensors = bracket.times().iter().map(of_time).collect::<Result<_, _>>()?;
        let truth = [sensor(1.0, point.psf_sigma)?, sensor(1.0, 0.0)?];
        Ok(Self { bracket, sensors, truth, range, seed, timer })
    }

    /// One frame.
    ///
    /// # Errors
    /// [`GridError`] for radiance that no sensor can be exposed to.
    pub fn pass(&mut self, Moment { number, frame, around }: &Moment) -> Result<Passed, GridError> {
        let now = &frame.radiance;
        let scenes: [&Array3<f32>; CAPTURES] = match around {
            Some([before, after]) => [before, now, after],
            None => [now; CAPTURES],
        };
        let seed = self.seed.wrapping_add(*number as u64);
        let start = self.timer.ticks_ns();
        let mut captures = Vec::with_capacity(CAPTURES);
        for (index, (sensor, scene)) in self.sensors.iter().zip(scenes).enumerate() {
            // Each capture has its own noise.
            let seed = seed.wrapping_add((index as u64) << 48);
            captures.push(sensor.expose(scene.view(), seed)?.saturated());
        }
        let sensed = self.timer.ticks_ns();
        let x = self.bracket.merge(&captures)?;
        let merged = self.timer.ticks_ns();
        let shown = tone::linear8(&x, self.range).map_err(modulo_core::SensorError::from)?;
        let toned = self.timer.ticks_ns();
        let [blurred, sharp] = &self.truth;
        let truth = [blurred.expose(now.view(), seed)?, sharp.expose(now.view(), seed)?];
        Ok(Passed {
            recovery: Recovery::of_merged(&shown, &truth[0], &truth[1]),
            image: Some(Arc::new(StampedFrame { header: Header::default(), frame: shown })),
            stages: vec![
                ("sense", sensed.saturating_sub(start)),
                ("merge", merged.saturating_sub(sensed)),
                ("tone", toned.saturating_sub(merged)),
            ],
        })
    }
}
