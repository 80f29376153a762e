//! [`AutoExposure`]: a normal camera of the same chip, whose exposure follows the frames before it.
//!
//! The exposure e of a frame is its time as a fraction of that of the modulo sensor, which is the longest possible one: no frame collects more
//! light. What is still too dark is brightened by a gain, so that e may be more than 1: the time is `min(e, 1)` and the gain `max(e, 1)`. Since a
//! fraction of the time collects that fraction of the light, the sensor of time t has the saturation factor `t alpha`. A frame n of exposure e_n
//! with the level m_n, of which [`Metering`] tells the goal g, asks for
//! ```text
//!     e_n g / m_n
//! ```
//! and the frame `n + delay` has this exposure, but differs from the frame before it at most by the factor `step`. The level is that of the clipped
//! codes, so that after a sudden glare the exposure falls in several steps, as that of a real camera does.

use std::collections::VecDeque;

use ndarray::ArrayView3;

use crate::frame::Frame;
use crate::gains::Gains;
use crate::metering::{Levels, Metering};
use crate::sensor::{Sensor, SensorConfig, SensorError};

/// The shortest exposure time, as a fraction of the longest, and the largest gain (36 dB).
const SHORTEST: f64 = 1.0 / 4096.0;
const LARGEST_GAIN: f64 = 64.0;

/// The frames of a still scene after which the exposure has settled, at most.
const SETTLING_FRAMES: usize = 40;

/// How the exposure follows the frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureControl {
    /// The pixels that decide.
    pub metering: Metering,
    /// The goal of the mean radiance, as a fraction of that of the largest code, more than 0 and at most 1.
    pub target: f64,
    /// The frames after which a measured frame takes effect, at least 1.
    pub delay: usize,
    /// The largest factor between the exposures of two frames, at least 1.
    pub step: f64,
}

/// A camera with automatic exposure.
#[derive(Clone, Debug)]
pub struct AutoExposure {
    sensor: SensorConfig,
    control: ExposureControl,
    /// The exposure of the last frame; `None` before the first one.
    exposure: Option<f64>,
    /// The exposures that the last frames ask for, which have not taken effect yet.
    asked: VecDeque<f64>,
}

impl AutoExposure {
    /// Makes a camera that has seen no frame. Its chip has one gain for all pixels.
    ///
    /// # Errors
    /// The errors of [`Sensor::new`].
    pub fn new(sensor: SensorConfig, control: ExposureControl) -> Result<Self, SensorError> {
        let sensor = SensorConfig { gains: Gains::One, ..sensor };
        Sensor::new(sensor)?;
        Ok(Self { sensor, control, exposure: None, asked: VecDeque::new() })
    }

    /// Takes over the exposure of a camera that this one replaces.
    pub fn go_on_from(&mut self, other: &Self) {
        (self.exposure, self.asked) = (other.exposure, other.asked.clone());
    }

    /// Returns the exposure of the last frame, in 1/4096 to 64: up to 1 its time as a fraction of that of the modulo sensor, above 1 its gain.
    /// `None` before the first frame.
    pub fn exposure(&self) -> Option<f64> {
        self.exposure
    }

    /// Takes the next frame, see [`Sensor::expose`], as the codes that the transfer function has for it. Before the first one, the camera has looked
    /// at its scene until its exposure settled.
    ///
    /// # Errors
    /// The errors of [`Sensor::expose`]; then the exposure stays as it was.
    pub fn expose(&mut self, radiance: ArrayView3<'_, f32>, seed: u64) -> Result<Frame, SensorError> {
        let last = match self.exposure {
            Some(exposure) => exposure,
            None => self.settled(radiance, seed)?,
        };
        // More frames are on their way where the delay has become shorter.
        let mut asked = None;
        while self.asked.len() >= self.control.delay.max(1) {
            asked = self.asked.pop_front();
        }
        let exposure = asked.map_or(last, |asked| self.followed(last, asked));
        let (image, asked) = self.image_of(exposure, radiance, seed)?;
        self.asked.push_back(asked);
        self.exposure = Some(exposure);
        Ok(image)
    }

    /// Returns the exposure at which that of a still scene settles.
    fn settled(&self, radiance: ArrayView3<'_, f32>, seed: u64) -> Result<f64, SensorError> {
        // Where nothing clips, the level is the true one.
        let mut exposure = self.sensor.alpha.recip().min(1.0);
        for _ in 0..SETTLING_FRAMES {
            let (_, asked) = self.image_of(exposure, radiance, seed)?;
            let last = std::mem::replace(&mut exposure, asked.clamp(SHORTEST, LARGEST_GAIN));
            if (exposure / last).ln().abs() < 0.01 {
                break;
            }
        }
        Ok(exposure)
    }

    /// Returns the exposure after `last` on the way to `asked`.
    fn followed(&self, last: f64, asked: f64) -> f64 {
        let step = self.control.step.max(1.0);
        asked.clamp(last / step, last * step).clamp(SHORTEST, LARGEST_GAIN)
    }

    /// Returns the image of an exposure, and the exposure that it asks for.
    fn image_of(
        &self,
        exposure: f64,
        radiance: ArrayView3<'_, f32>,
        seed: u64,
    ) -> Result<(Frame, f64), SensorError> {
        let (time, gain) = (exposure.min(1.0), exposure.max(1.0) as f32);
        let sensor = Sensor::new(SensorConfig { alpha: time * self.sensor.alpha, ..self.sensor })?;
        let captured = sensor.expose(radiance, seed)?;
        let most = captured.range().peak() - 1.0;
        // The gain brightens whole codes.
        let codes = captured.saturated_radiance().mapv_into(|code| (gain * code).min(most));
        let levels = Levels::of(&codes, most, self.control.metering);
        // A black image asks for the longest time.
        let asked = levels.ratio(self.control.target).map_or(1.0, |ratio| exposure * ratio);
        Ok((captured.clipped(&codes), asked))
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

    fn level(image: &Frame) -> f64 {
        f64::from(image.to_f32().mean().unwrap()) / 255.0
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
            assert!((camera.exposure().unwrap() / expected - 1.0).abs() < 0.02);
        }
    }

    #[test]
    fn what_is_dark_at_the_longest_time_is_brightened_by_a_gain() {
        let mut camera = camera(CONTROL);
        // 0.012 * 1024 = 12.3, whose 12 whole codes need a gain of 5.3 up to 0.25 * 255.
        let dark = camera.expose(grey(0.012).view(), 0).unwrap();
        assert!((camera.exposure().unwrap() - 0.25 * 255.0 / 12.0).abs() < 0.1, "{:?}", camera.exposure());
        assert!((63..=64).contains(&dark.as_u8().unwrap()[(0, 0, 0)]));
        camera.expose(grey(0.0).view(), 0).unwrap();
        assert!(camera.exposure().unwrap() <= LARGEST_GAIN, "a black frame asks for no impossible exposure");
    }

    #[test]
    fn a_change_of_light_takes_effect_after_the_delay_and_in_steps() {
        for delay in 1..=3 {
            let mut camera = camera(ExposureControl { delay, ..CONTROL });
            camera.expose(grey(0.1).view(), 0).unwrap();
            let before = camera.exposure().unwrap();
            let times: Vec<f64> = (0..12)
                .map(|_| {
                    camera.expose(grey(0.8).view(), 0).unwrap();
                    camera.exposure().unwrap() / before
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
            camera.exposure().unwrap()
        };
        assert!(time(Metering::Centre) < 0.8 * time(Metering::Mean));
        // 0.5 * 1024 t = 0.95 * 255
        assert!((time(Metering::Highlights) - 0.473).abs() < 0.01, "{}", time(Metering::Highlights));
    }

    #[test]
    fn a_changed_sensor_keeps_the_exposure_time() {
        let mut camera = camera(CONTROL);
        camera.expose(grey(0.8).view(), 0).unwrap();
        let before = camera.exposure();
        let mut other =
            AutoExposure::new(SensorConfig { read_noise: 1.0, ..SensorConfig::default() }, CONTROL).unwrap();
        other.go_on_from(&camera);
        other.expose(grey(0.8).view(), 0).unwrap();
        assert_eq!(other.exposure(), before);
    }
}
