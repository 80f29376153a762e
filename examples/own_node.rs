//! A node of one's own in the suite: it publishes the lower half of each image of `/recovered` on `/road/image`.
//!
//!     cargo run --release -- launch launch/sensor.launch.yaml loop:=true detectors:=[road] &
//!     cargo run --release --example own_node
//!     ros2 param set /road first_row 0.6
//!     ros2 node info /road

use std::sync::Arc;

use modulo_core::Frame;
use modulo_middleware::driver::live::{self, NodeSetup};
use modulo_middleware::process::signals::end_on_signals;
use modulo_middleware::transport::zenoh::ZenohTransport;
use modulo_runtime::wire::keys::Hashes;
use modulo_runtime::*;
use ndarray::{Axis, Slice};

parameters! {
    /// The node, whose fields are its parameters.
    pub struct Road {
        /// First row that is kept, as a fraction of the height.
        first_row: f64 = 0.5 => 0.0..=0.9,
    }
}

impl Node for Road {
    fn inputs(&self) -> Vec<Topic> {
        vec![Topic::new("/recovered", MessageKind::Image)]
    }
    fn outputs(&self) -> Vec<Topic> {
        vec![Topic::new("~/image", MessageKind::Image)]
    }
    fn configure(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        *self = Self::from(parameters);
        Ok(())
    }
    fn step(&mut self, trigger: Trigger, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        if let Trigger::Message { message: Message::Image(image), .. } = trigger
            && let Some(pixels) = image.frame.as_u8()
        {
            let first = (self.first_row * image.frame.height() as f64) as usize;
            let road = pixels.slice_axis(Axis(0), Slice::from(first..)).to_owned();
            let frame = Frame::from_u8(road).map_err(|why| StepError::Skip(why.to_string()))?;
            cx.emit(0, StampedFrame { header: image.header.clone(), frame });
        }
        Ok(Flow::Continue)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock::default());
    let stop = Stop::default();
    end_on_signals(&stop)?;
    let domain = std::env::var("ROS_DOMAIN_ID").map_or(Ok(0), |id| id.parse())?;
    let transport = ZenohTransport::open(domain, Hashes::Rihs01, clock.clone())?;
    let parameters = Parameters::declare(Road::descriptors());
    let node_name = NodeName::new("road", "/", &[])?;
    let setup =
        NodeSetup { node: Box::new(Road::default()), parameters, node_name, saved: None, report_file: None };
    live::run(setup, &transport, &clock, stop)?;
    Ok(())
}
