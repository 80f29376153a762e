//! The parameters of the `modulo_camera` node, and the sensor that they describe.

use std::time::Duration;

use modulo_core::sensor::{Sensor, SensorConfig};
use modulo_runtime::{ParameterError, ParameterSet as _, SensorModel};

modulo_runtime::parameters! {
    /// The parameters of the `modulo_camera` node.
    pub struct CameraParameters {
        /// Source of the frames: a folder of images (png, jpg, exr, hdr), one image, a KITTI folder, a bag,
        /// scene://NAME, or topic:NAME for an Image topic of a running stack. Another source starts with its first frame.
        source: String = String::new(),
        /// The image topic to read from a source that is a bag. Empty: the only image topic of the bag.
        source_topic: String = String::new(); fixed,
        /// Value that becomes full scale, for EXR, HDR and 16-bit images. 0: the 99.9th percentile of the first EXR or
        /// HDR image, and 65536 for 16-bit images.
        white: f64 = 0.0 => 0.0..=1e12; fixed,
        /// Standard deviation of the read noise in code units.
        read_noise: f64 = 0.0 => 0.0..=65536.0,
        /// Strength of the shot noise: its standard deviation at the signal x is sqrt(shot_noise * x) in code units.
        shot_noise: f64 = 0.0 => 0.0..=65536.0,
        /// Seed of the noise.
        seed: i64 = 0 => 0..=i64::MAX,
        /// Frames per second. 0: the next frame as soon as every reader has taken the last one.
        rate: f64 = 0.0 => 0.0..=10_000.0,
        /// Starts again at the first frame after the last one.
        r#loop: bool = false; fixed,
        /// Number of frames of the source to send before the node ends. 0: all of them.
        frames: i64 = 0 => 0..=i64::MAX,
        /// Coordinate frame of the images, with the axes of an optical frame of REP 103 (z forward, x right, y down).
        /// Empty: that of the source, and camera_optical for a source without one.
        frame_id: String = String::new(),
        ..sensor: SensorModel,
    }
}

impl CameraParameters {
    /// Returns the simulated sensor.
    ///
    /// # Errors
    /// [`ParameterError`] of the first parameter that is out of its range.
    pub fn sensor(&self) -> Result<Sensor, ParameterError> {
        self.check()?;
        let SensorModel { bits, alpha, .. } = self.sensor;
        let Self { read_noise, shot_noise, .. } = *self;
        let sensor =
            Sensor::new(SensorConfig { bits, alpha, psf: self.sensor.psf(), read_noise, shot_noise });
        Ok(sensor.expect("the declared ranges lie within those of `Sensor`"))
    }

    /// Returns the time between two frames. Zero: as fast as its readers take them.
    pub(crate) fn period(&self) -> Duration {
        match self.rate {
            0.0 => Duration::ZERO,
            rate => Duration::from_secs_f64(1.0 / rate.max(1e-6)),
        }
    }

    /// Returns the number of frames to send, if not all.
    pub(crate) fn limit(&self) -> Option<u64> {
        Some(self.frames.unsigned_abs()).filter(|&frames| frames > 0)
    }
}
