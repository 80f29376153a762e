//! [`maker`]: three captures with different exposure times, merged as a normal camera does for a high dynamic range.
//!
//! The captures are three consecutive frames of the drive with the longest exposure last; the middle one is the frame
//! that is scored. Moving objects leave ghosts: the captures are not aligned.

use modulo_core::{Bracket, Sensor, SensorConfig, SensorError, Transfer, tone};
use modulo_runtime::SensorModel;
use ndarray::Array3;

use crate::GridError;
use crate::handed::{HandedFrame, Make};

/// Number of captures that are merged.
pub const CAPTURES: usize = 3;

/// The captures and the merging of `sensor`.
pub fn maker(sensor: &SensorModel) -> Result<Make, GridError> {
    let (range, sensor) = (sensor.range()?, sensor.config()?);
    let bracket = Bracket::new(range, CAPTURES);
    // An exposure of a fraction of the time sees that fraction of the light: alpha is multiplied by the time.
    let of_time = |time: &f32| {
        let alpha = sensor.alpha * f64::from(*time);
        // Captures are merged before they are shown.
        Sensor::new(SensorConfig { alpha, transfer: Transfer::Linear, ..sensor })
    };
    let sensors = bracket.times().iter().map(of_time).collect::<Result<Vec<_>, _>>()?;
    let transfer = sensor.transfer;
    Ok(Box::new(move |HandedFrame { frame, around, .. }, seed, _, cx| {
        let now = &frame.radiance;
        // The scene of the scored frame is in the middle, so that the ghosts lie on both sides of a moving object.
        let scenes: [&Array3<f32>; CAPTURES] = match around {
            Some([before, after]) => [before, now, after],
            None => [now; CAPTURES],
        };
        let capture = |(index, (sensor, scene)): (u64, (&Sensor, &Array3<f32>))| {
            // Each capture has its own noise. The upper bits keep its seed apart from those of the following frames.
            Ok(sensor.expose(scene.view(), seed.wrapping_add(index << 48))?.saturated())
        };
        let captures = cx.stage("sense", || {
            (0..).zip(sensors.iter().zip(scenes)).map(capture).collect::<Result<Vec<_>, SensorError>>()
        })?;
        let x = cx.stage("merge", || bracket.merge(&captures))?;
        Ok(cx.stage("tone", || tone::picture(&x, range, transfer)).map_err(SensorError::from)?)
    }))
}
