//! [`PublishedSpud`]: SPUD as the scripts of the paper have it, which no node has: it takes the modulo image before quantisation, and stretches
//! phi over all channels from minimum to maximum, without congruence. `spud` takes the quantised image y, and its result is y plus whole
//! periods.

use modulo_bags::source::{Source, SourceFrame};
use modulo_camera::CameraParameters;
use modulo_core::unwrap::{Spud, ThresholdOn};
use modulo_core::{Frame, UnwrapError};
use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::{
    Context, Flow, MessageKind, Node, ParameterError, Parameters, SensorModel, StampedFrame, StepError,
    Topic, Trigger,
};
use ndarray::Array3;

use crate::GridError;

/// The method of its cells, and the name of the node as an executable.
pub const SPUD_AS_PUBLISHED: &str = "spud_as_published";

/// Threshold of SPUD on phi, in units of the peak.
const TAU: f64 = 0.1;

/// Its topic.
pub fn output() -> Topic {
    Topic::new("recovered", MessageKind::Image)
}

/// A camera with its unwrapping.
pub struct PublishedSpud {
    sensor: SensorModel,
    spud: Spud,
    /// The seed of the noise of the first frame.
    seed: u64,
    /// The place of the next frame.
    place: u64,
    source: Source,
}

impl PublishedSpud {
    /// Prepares the sensor of a camera over the frames of `source`.
    pub fn new(camera: &CameraParameters, source: Source) -> Result<Self, GridError> {
        camera.sensor.simulated()?;
        let (sensor, spud) = (camera.sensor.clone(), Spud::new(TAU, ThresholdOn::Phi)?);
        Ok(Self { sensor, spud, seed: camera.seed.unsigned_abs(), place: 0, source })
    }

    fn recovered(&mut self, frame: &SourceFrame, cx: &mut Context<'_>) -> Result<Frame, GridError> {
        let (sensor, range) = (self.sensor.simulated()?, self.sensor.range()?);
        // The noise of a frame is that of the other cells.
        let seed = self.seed.wrapping_add(self.place);
        let radiance = frame.radiance_for(&self.sensor)?;
        let y = cx.stage("sense", || sensor.expose(radiance.view(), seed))?.charge();
        // The result has an arbitrary offset and scale, and therefore no wrap counts.
        let x = cx.stage("unwrap", || self.spud.solve(y.view(), range).map(|x| stretched(&x)))?;
        Ok(Frame::from_u8(x).map_err(UnwrapError::from)?)
    }
}

impl Node for PublishedSpud {
    fn inputs(&self) -> Vec<Topic> {
        Vec::new()
    }

    fn outputs(&self) -> Vec<Topic> {
        vec![output()]
    }

    fn configure(&mut self, _: &Parameters) -> Result<(), ParameterError> {
        Ok(())
    }

    fn resume(&mut self, position: u64) {
        self.place = position;
    }

    fn step(&mut self, _: Trigger, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        let Some(frame) = self.source.next() else { return Ok(Flow::Done) };
        let header = Header { stamp: Time::from_ns(cx.now_ns()), ..Header::default() };
        let recovered = frame.map_err(GridError::from).and_then(|frame| self.recovered(&frame, cx));
        let frame = recovered.map_err(|why| StepError::Skip(why.to_string()))?;
        cx.emit(0, StampedFrame { header, frame });
        Ok(Flow::Continue)
    }
}

/// Maps minimum and maximum over all channels to 0 and 255 and truncates to whole steps, as the scripts convert an image for the detector. A
/// constant image becomes 0.
fn stretched(values: &Array3<f32>) -> Array3<u8> {
    let low = f64::from(values.iter().copied().fold(f32::INFINITY, f32::min));
    let high = f64::from(values.iter().copied().fold(f32::NEG_INFINITY, f32::max));
    // The multiplication comes first, so that an image that spans 0 to 255 stays unchanged.
    let step = |v: f32| ((f64::from(v) - low) * 255.0 / (high - low)).floor() as u8;
    values.mapv(|v| if high > low { step(v) } else { 0 })
}

#[cfg(test)]
mod tests {
    use modulo_bags::source::{SourceOptions, open};
    use modulo_runtime::ManualClock;

    use super::*;

    #[test]
    fn x_raw_is_stretched_over_all_channels_and_cut() {
        let values = Array3::from_shape_vec((1, 2, 3), vec![10.0, 11.0, 12.0, 13.0, 14.0, 20.0]).expect("6");
        let got: Vec<u8> = stretched(&values).iter().copied().collect();
        assert_eq!(got, [0, 25, 51, 76, 102, 255]);
        let all = Array3::from_shape_fn((1, 256, 1), |(_, x, _)| x as f32);
        assert!(stretched(&all).iter().copied().eq(0..=255), "what spans all stays");
        assert!(stretched(&Array3::from_elem((2, 2, 3), 0.4)).iter().all(|v| *v == 0));
    }

    #[test]
    fn spud_is_stretched_as_published() {
        let sensor = SensorModel { alpha: 1.5, headroom: 1.0, psf_sigma: 1.4, ..SensorModel::default() };
        let camera = CameraParameters { sensor, ..CameraParameters::default() };
        let source = open("scene://day?frames=1", &SourceOptions::default()).expect("a scene");
        let mut published = PublishedSpud::new(&camera, source).expect("possible");
        let radiance = Array3::from_shape_fn((32, 256, 1), |(_, x, _)| x as f32 / 384.0);
        let (name, frame_id) = (String::new(), String::new());
        let frame =
            SourceFrame { radiance, name, stamp_ns: None, frame_id, ground_truth: None, full_resets: None };
        let clock = ManualClock::default();
        let image = published.recovered(&frame, &mut Context::new("/spud", &clock, &[])).expect("recovered");
        let image = image.as_u8().expect("8 bits");
        assert_eq!((image.iter().min(), image.iter().max()), (Some(&0), Some(&255)), "minimum and maximum");
    }
}
