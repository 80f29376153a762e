//! [`SuitePipeline`]: a frame through the camera and the unwrapping node of the suite, in lockstep.

use modulo_bags::source::{Source, SourceError, SourceFrame};
use modulo_camera::{CameraParameters, ModuloCamera};
use modulo_core::unwrap::Method;
use modulo_msgs::std_msgs::Header;
use modulo_runtime::lockstep::Lockstep;
use modulo_runtime::{Message, SensorOverride, sensor_info};
use modulo_unwrap::{UnwrapNode, UnwrapParameters};
use ndarray::{Array3, Axis};

use super::{DetectorInput, PipelineConfig, RecoveryQuality, Truth, node_name, stamp};
use crate::GridError;
use crate::messages::{image, recovery};
use crate::results::{Point, Stream};

/// The nodes of one cell before its detector.
pub struct SuitePipeline<'a> {
    config: PipelineConfig<'a>,
    stream: Stream,
    camera: CameraParameters,
    unwrap: Option<Lockstep<'a>>,
    /// The channels of the last frame, for which the sensor was described to the unwrapping node.
    described: Option<usize>,
    truth: Truth,
}

impl<'a> SuitePipeline<'a> {
    pub fn new(point: &Point, config: PipelineConfig<'a>) -> Result<Self, GridError> {
        let sensor = &point.sensor;
        let recovers = point.method.as_ref().filter(|_| point.stream.is_unwrapped());
        let unwrap = recovers.map(|method| {
            // Gains have a method of their own, which the node takes whatever the parameter.
            let method = if sensor.gains { Method::Auto } else { method.parse()? };
            // Without a description for each frame, only these two are known for all of them.
            let own = SensorOverride {
                bits: Some(sensor.bits),
                alpha: Some(sensor.alpha),
                ..SensorOverride::default()
            };
            let with =
                UnwrapParameters { method, deblur: point.deblur, sensor: own, ..UnwrapParameters::default() };
            let topics = ["/recovered", "/hdr", "/diagnostics", "/metered"];
            let wanted = if point.stream == Stream::Metered { 4 } else { 3 };
            let topics = topics[..wanted].iter().map(|&topic| topic.to_owned()).collect();
            let mut chain = Lockstep::new(config.timer, topics);
            chain.add(Box::new(UnwrapNode::new(&with)?), &node_name("unwrap"))?;
            Ok::<_, GridError>(chain)
        });
        let truth = Truth::of(sensor.config()?)?;
        let camera = CameraParameters { sensor: sensor.clone(), ..CameraParameters::default() };
        Ok(Self { config, stream: point.stream, camera, unwrap: unwrap.transpose()?, described: None, truth })
    }

    /// Processes frame `number`. The seed of its noise depends only on its number.
    pub fn run(&mut self, number: usize, frame: SourceFrame) -> Result<DetectorInput, GridError> {
        // The noise depends on the number of the frame alone, so that it does not depend on the worker that gets the
        // frame, and is the same in all cells. The parameter of the node is a signed integer.
        let seed = (self.config.seed.wrapping_add(number as u64) & i64::MAX as u64) as i64;
        let compared = self.config.compares && (self.unwrap.is_some() || self.stream == Stream::Saturated);
        let radiance = compared.then(|| frame.radiance.clone());
        self.describe(frame.radiance.len_of(Axis(2)))?;
        let sensed = match self.stream {
            Stream::Ideal => "/ideal",
            Stream::Saturated => "/saturated",
            Stream::Modulo | Stream::Recovered | Stream::Metered => "/modulo",
            Stream::AutoExposed | Stream::MultiExposure | Stream::MultiExposureStill => {
                unreachable!("these streams have a pipeline of their own")
            }
        };
        let with = CameraParameters { seed, ..self.camera.clone() };
        // The camera seeds the noise of a frame by its own count of frames. With one camera for a worker, the noise of
        // a frame would depend on the frames that this worker had before.
        let mut camera = Lockstep::new(self.config.timer, vec![sensed.to_owned()]);
        let source = Box::new(SingleFrame(Some(frame)));
        camera.add(Box::new(ModuloCamera::over(source, &with)?), &node_name("camera"))?;
        // The camera skips a frame that it cannot expose. The cell counts it as unanswered.
        let Some(out) = camera.tick(0, stamp(number))? else { return Ok(DetectorInput::default()) };
        let (image_sensed, stages) = (image(&out, sensed).cloned(), camera.stages().to_vec());
        let mut passed = DetectorInput { image: image_sensed, stages, ..DetectorInput::default() };
        let scene = radiance.as_ref().map(|radiance| (radiance, seed.unsigned_abs()));
        if self.unwrap.is_some() {
            self.recover(&mut passed, stamp(number), scene)?;
        } else if let (Some(scene), Some(codes)) = (scene, passed.image.clone()) {
            passed.recovery = RecoveryQuality::of_saturated(&codes.frame, &self.truth.expose(scene)?);
        }
        Ok(passed)
    }

    /// Describes the sensor to the unwrapping node, as the camera does for images of so many channels.
    fn describe(&mut self, channels: usize) -> Result<(), GridError> {
        if let Some(unwrap) = &mut self.unwrap
            && self.described.replace(channels) != Some(channels)
        {
            let sensor = self.camera.sensor.of_channels(channels);
            unwrap.feed(
                "/sensor_info",
                sensor_info::message(&Header::default(), &sensor, "/modulo_camera", []),
                0,
            )?;
        }
        Ok(())
    }

    /// Replaces the modulo image by the recovered one, and compares it with the true exposures of `scene` (radiance, seed).
    fn recover(
        &mut self,
        passed: &mut DetectorInput,
        stamp_ns: u64,
        scene: Option<(&Array3<f32>, u64)>,
    ) -> Result<(), GridError> {
        let (Some(unwrap), Some(modulo)) = (&mut self.unwrap, passed.image.take()) else { return Ok(()) };
        let out = unwrap.feed("/modulo", Message::Image(modulo), stamp_ns)?;
        passed.stages.extend(unwrap.stages());
        let shown = if self.stream == Stream::Metered { "/metered" } else { "/recovered" };
        passed.image = image(&out, shown).cloned();
        // The quality is computed outside the chain, whose stages are timed.
        if let (Some(scene), Some(toned), Some(counts)) =
            (scene, image(&out, "/recovered"), image(&out, "/hdr"))
        {
            let (said, truth) = (recovery(&out, "/diagnostics"), self.truth.expose(scene)?);
            passed.recovery = said
                .and_then(|said| RecoveryQuality::of_unwrapped(&counts.frame, &toned.frame, said, &truth));
        }
        Ok(())
    }
}

struct SingleFrame(Option<SourceFrame>);

impl Source for SingleFrame {
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        self.0.take().map(Ok)
    }

    fn len(&self) -> Option<usize> {
        Some(1)
    }

    fn rewind(&mut self) -> Result<(), SourceError> {
        Ok(())
    }
}
