//! [`AutoExposure`]: a normal camera of the same chip, whose exposure time follows the frames before it.
//!
//! The time t of a frame is a fraction of the time of the modulo sensor, which is the longest possible one: no frame collects more light.
//! Since a fraction of the time collects that fraction of the light, the sensor of time t has the saturation factor `t alpha`. A frame n of
//! time t_n with the level m_n, of which [`Metering`] tells the goal g, asks for
//! ```text
//!     t_n g / m_n
//! ```
//! and the frame `n + delay` has this time, but differs from the frame before it at most by the factor `step`. The level is that of the clipped
//! codes, so that after a sudden glare the time falls in several steps, as that of a real camera does.

use std::collections::VecDeque;

use ndarray::ArrayView3;

use crate::gains::Gains;
use crate::metering::{Levels, Metering};
use crate::sensor::{Exposure, Sensor, SensorConfig, SensorError};

/// The shortest exposure time, as a fraction of the longest.
const SHORTEST: f64 = 1.0 / 4096.0;

/// The frames of a still scene after which the exposure has settled, at most.
const SETTLING_FRAMES: usize = 40;

/// How the exposure follows the frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureControl {
    /// What it looks at.
    pub metering: Metering,
    /// The goal of the mean, as a fraction of the largest code of the image, more than 0 and at most 1.
    pub target: f64,
    /// The frames after which a measured frame takes effect, at least 1.
    pub delay: usize,
    /// The largest factor between the exposure times of two frames, at least 1.
    pub step: f64,
}

/// A camera with automatic exposure.
#[derive(Clone, Debug)]
pub struct AutoExposure {
    sensor: SensorConfig,
    control: ExposureControl,
    /// The exposure time of the last frame; `None` before the first one.
    time: Option<f64>,
    /// The times that the last frames ask for, which have not taken effect yet.
    asked: VecDeque<f64>,
}

impl AutoExposure {
    /// Makes a camera that has seen no frame. Its chip has one gain.
    ///
    /// # Errors
    /// The errors of [`Sensor::new`].
    pub fn new(sensor: SensorConfig, control: ExposureControl) -> Result<Self, SensorError> {
        let sensor = SensorConfig { gains: Gains::One, ..sensor };
        Sensor::new(sensor)?;
        Ok(Self { sensor, control, time: None, asked: VecDeque::new() })
    }

    /// Takes over the exposure time of a camera that this one replaces.
    pub fn go_on_from(&mut self, other: &Self) {
        (self.time, self.asked) = (other.time, other.asked.clone());
    }

    /// Returns the exposure time of the last frame as a fraction of that of the modulo sensor; `None` before the first frame.
    pub fn time(&self) -> Option<f64> {
        self.time
    }

    /// Exposes the next frame, see [`Sensor::expose`]. Before the first one, the camera has looked at its scene until its exposure settled.
    ///
    /// # Errors
    /// The errors of [`Sensor::expose`]; then the exposure stays as it was.
    pub fn expose(&mut self, radiance: ArrayView3<'_, f32>, seed: u64) -> Result<Exposure, SensorError> {
        let last = match self.time {
            Some(time) => time,
            None => self.settled(radiance, seed)?,
        };
        // More frames are on their way where the delay has become shorter.
        let mut asked = None;
        while self.asked.len() >= self.control.delay.max(1) {
            asked = self.asked.pop_front();
        }
        let time = asked.map_or(last, |asked| self.followed(last, asked));
        let exposure = self.sensor_of(time)?.expose(radiance, seed)?;
        self.asked.push_back(self.asked_by(&exposure, time));
        self.time = Some(time);
        Ok(exposure)
    }

    /// Returns the time at which the exposure of a still scene settles.
    fn settled(&self, radiance: ArrayView3<'_, f32>, seed: u64) -> Result<f64, SensorError> {
        // Where nothing clips, the level is the true one.
        let mut time = self.sensor.alpha.recip().min(1.0);
        for _ in 0..SETTLING_FRAMES {
            let asked = self.asked_by(&self.sensor_of(time)?.expose(radiance, seed)?, time);
            let last = std::mem::replace(&mut time, asked.clamp(SHORTEST, 1.0));
            if (time / last).ln().abs() < 0.01 {
                break;
            }
        }
        Ok(time)
    }

    /// Returns the time after `last` on the way to `asked`.
    fn followed(&self, last: f64, asked: f64) -> f64 {
        let step = self.control.step.max(1.0);
        asked.clamp(last / step, last * step).clamp(SHORTEST, 1.0)
    }

    /// Returns the sensor of an exposure time.
    fn sensor_of(&self, time: f64) -> Result<Sensor, SensorError> {
        Sensor::new(SensorConfig { alpha: time * self.sensor.alpha, ..self.sensor })
    }

    /// Returns the time that an image of so long a time asks for.
    fn asked_by(&self, exposure: &Exposure, time: f64) -> f64 {
        let goal = self.sensor.transfer.decode(self.control.target);
        let levels = Levels::of(exposure.x(), exposure.range().peak() - 1.0, self.control.metering);
        // A black image asks for the longest time.
        levels.ratio(goal).map_or(1.0, |ratio| time * ratio)
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    const CONTROL: ExposureControl =
        ExposureControl { metering: Metering::Mean, target: 0.25, delay: 2, step: 1.5 };

    fn camera(control: ExposureControl) -> AutoExposure {
        AutoExposure::new(SensorConfig { alpha: 4.0, ..SensorConfig::default() }, control).unwrap()
    }

    fn grey(radiance: f32) -> Array3<f32> {
        Array3::from_elem((8, 8, 1), radiance)
    }

    fn level(exposure: &Exposure) -> f64 {
        f64::from(exposure.x().mapv(|x| x.min(255.0)).mean().unwrap()) / 255.0
    }

    #[test]
    fn the_exposure_of_a_still_scene_has_settled_at_its_first_frame() {
        for radiance in [0.1, 0.3, 0.9] {
            let mut camera = camera(CONTROL);
            for _ in 0..3 {
                let exposure = camera.expose(grey(radiance).view(), 0).unwrap();
                assert!((level(&exposure) - 0.25).abs() < 0.01, "{radiance}: {}", level(&exposure));
            }
            // x = t 4 * 256 radiance, and 0.25 * 255 is the goal.
            let expected = 0.25 * 255.0 / (1024.0 * f64::from(radiance));
            assert!((camera.time().unwrap() / expected - 1.0).abs() < 0.02);
        }
    }

    #[test]
    fn the_longest_time_is_that_of_the_modulo_sensor() {
        let mut camera = camera(CONTROL);
        let dark = camera.expose(grey(0.01).view(), 0).unwrap();
        assert_eq!(camera.time(), Some(1.0));
        let plain = Sensor::new(SensorConfig::default()).unwrap().expose(grey(0.01).view(), 0).unwrap();
        assert_eq!(dark.saturated(), plain.saturated());
        camera.expose(grey(0.0).view(), 0).unwrap();
        assert_eq!(camera.time(), Some(1.0), "a black frame asks for no impossible time");
    }

    #[test]
    fn a_change_of_light_takes_effect_after_the_delay_and_in_steps() {
        for delay in 1..=3 {
            let mut camera = camera(ExposureControl { delay, ..CONTROL });
            camera.expose(grey(0.1).view(), 0).unwrap();
            let before = camera.time().unwrap();
            let times: Vec<f64> = (0..12)
                .map(|_| {
                    camera.expose(grey(0.8).view(), 0).unwrap();
                    camera.time().unwrap() / before
                })
                .collect();
            assert!(times[..delay].iter().all(|time| (time - 1.0).abs() < 0.02), "{times:?}");
            assert!((times[delay] - 1.0 / 1.5).abs() < 0.02, "one step of the allowed size: {times:?}");
            assert!((times[11] - 0.125).abs() < 0.01, "eight times the light: {times:?}");
            assert!(times.is_sorted_by(|a, b| *a >= b - 0.02), "no overshoot: {times:?}");
        }
    }

    #[test]
    fn each_metering_looks_at_its_pixels() {
        // A bright square in the middle of one eighth of the area.
        let scene = Array3::from_shape_fn((32, 32, 1), |(i, j, _)| {
            let is_bright = (10..22).contains(&i) && (10..22).contains(&j);
            if is_bright { 0.5 } else { 0.02 }
        });
        let time = |metering| {
            let mut camera = camera(ExposureControl { metering, ..CONTROL });
            camera.expose(scene.view(), 0).unwrap();
            camera.time().unwrap()
        };
        assert!(time(Metering::Centre) < 0.8 * time(Metering::Mean));
        // 0.5 * 1024 t = 0.95 * 255
        assert!((time(Metering::Highlights) - 0.473).abs() < 0.01, "{}", time(Metering::Highlights));
    }

    #[test]
    fn a_changed_sensor_keeps_the_exposure_time() {
        let mut camera = camera(CONTROL);
        camera.expose(grey(0.8).view(), 0).unwrap();
        let before = camera.time();
        let mut other =
            AutoExposure::new(SensorConfig { read_noise: 1.0, ..SensorConfig::default() }, CONTROL).unwrap();
        other.go_on_from(&camera);
        other.expose(grey(0.8).view(), 0).unwrap();
        assert_eq!(other.time(), before);
    }
}
