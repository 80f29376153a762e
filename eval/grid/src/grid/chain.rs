//! From a frame to the image that the detector of a cell sees, through the suite's own steps in lockstep.

use std::sync::Arc;

use modulo_bags::source::{Source, SourceError, SourceFrame};
use modulo_camera::CameraParameters;
use modulo_core::Sensor;
use modulo_msgs::diagnostic_msgs::DiagnosticArray;
use modulo_runtime::driver::lockstep::{Lockstep, OnTopic};
use modulo_runtime::{Clock, Message, NodeName, SensorModel, StampedFrame};
use modulo_unwrap::UnwrapParameters;

use super::nodes::Nodes;
use super::recovery::Recovery;
use super::{BITS, GridError};
use crate::results::{Point, Stream};

/// (stage, nanoseconds) in the order in which they came.
pub type Stages = Vec<(&'static str, u64)>;

/// What came of a frame before the detector.
#[derive(Default)]
pub struct Passed {
    /// What the detector sees; `None` where a step gave no answer.
    pub image: Option<Arc<StampedFrame>>,
    /// How long it took.
    pub stages: Stages,
    /// How near a recovered image is to the truth.
    pub recovery: Option<Recovery>,
}

/// The steps of one cell before its detector.
pub struct Chain<'a> {
    nodes: &'a dyn Nodes,
    timer: &'a dyn Clock,
    stream: Stream,
    camera: CameraParameters,
    unwrap: Option<Lockstep<'a>>,
    /// The truth's own sensors: the cell's, and the same without a lens.
    sensors: [Sensor; 2],
    seed: u64,
}

impl<'a> Chain<'a> {
    /// For one cell.
    ///
    /// # Errors
    /// [`GridError`] for a parameter that is not possible.
    pub fn new(
        nodes: &'a dyn Nodes,
        timer: &'a dyn Clock,
        point: &Point,
        seed: u64,
    ) -> Result<Self, GridError> {
        let lens = |psf_sigma| CameraParameters {
            read_noise: point.noise,
            sensor: SensorModel { bits: BITS, alpha: point.alpha, psf_sigma, ..SensorModel::default() },
            ..CameraParameters::default()
        };
        let camera = lens(point.psf_sigma);
        let unwrap = point.method.as_ref().map(|method| {
            let (method, sensor) = (method.parse()?, camera.sensor.clone().into());
            let with = UnwrapParameters { method, deblur: point.deblur, sensor, ..Default::default() };
            let topics = ["/recovered", "/hdr", "/diagnostics"].map(str::to_owned).to_vec();
            let mut chain = Lockstep::new(timer, topics);
            chain.add(nodes.unwrap(&with)?, &node_name("unwrap"))?;
            Ok::<_, GridError>(chain)
        });
        let sensors = [camera.sensor()?, lens(0.0).sensor()?];
        Ok(Self { nodes, timer, stream: point.stream, camera, unwrap: unwrap.transpose()?, sensors, seed })
    }

    /// Frame `number`, whose noise is seeded by its number alone.
    ///
    /// # Errors
    /// [`GridError`] when a step cannot go on.
    pub fn pass(&mut self, number: usize, frame: SourceFrame) -> Result<Passed, GridError> {
        let seed = (self.seed.wrapping_add(number as u64) & i64::MAX as u64) as i64;
        let radiance = self.unwrap.is_some().then(|| frame.radiance.clone());
        let sensed = match self.stream {
            Stream::Ideal => "/ideal",
            Stream::Saturated => "/saturated",
            Stream::Modulo | Stream::Recovered => "/modulo",
            // Another way altogether.
            Stream::MultiExposure | Stream::MultiExposureStill => return Ok(Passed::default()),
        };
        let with = CameraParameters { seed, ..self.camera.clone() };
        let mut camera = Lockstep::new(self.timer, vec![sensed.to_owned()]);
        camera.add(self.nodes.camera(Box::new(One(Some(frame))), &with)?, &node_name("camera"))?;
        let out = camera.tick(0, now(number))?.unwrap_or_default();
        let mut passed =
            Passed { image: image(&out, sensed), stages: camera.stages().to_vec(), recovery: None };
        if let (Some(unwrap), Some(radiance)) = (&mut self.unwrap, radiance) {
            let Some(modulo) = passed.image.take() else { return Ok(passed) };
            let out = unwrap.feed("/modulo", Message::Image(modulo), now(number))?;
            passed.stages.extend(unwrap.stages());
            passed.image = image(&out, "/recovered");
            if let (Some(shown), Some(counts)) = (&passed.image, image(&out, "/hdr")) {
                let [blurred, sharp] = &self.sensors;
                let seed = seed.unsigned_abs();
                let [exposure, sharp] =
                    [blurred.expose(radiance.view(), seed)?, sharp.expose(radiance.view(), seed)?];
                passed.recovery = Recovery::new(&counts.frame, &shown.frame, said(&out), &exposure, &sharp);
            }
        }
        Ok(passed)
    }
}

/// Time of a frame for its steps: KITTI's 10 Hz.
pub fn now(number: usize) -> u64 {
    number as u64 * 100_000_000
}

/// A node in the root namespace; the names here are all ROS names.
pub fn node_name(name: &str) -> NodeName {
    NodeName { name: name.to_owned(), namespace: "/".to_owned(), remaps: Vec::new() }
}

fn image(out: &[OnTopic], topic: &str) -> Option<Arc<StampedFrame>> {
    out.iter().find(|(name, _)| name == topic).and_then(|(_, message)| match message {
        Message::Image(image) => Some(image.clone()),
        _ => None,
    })
}

fn said(out: &[OnTopic]) -> Option<&DiagnosticArray> {
    out.iter().find_map(|(_, message)| match message {
        Message::Diagnostics(said) => Some(&**said),
        _ => None,
    })
}

/// A source of a single frame.
struct One(Option<SourceFrame>);

impl Source for One {
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
