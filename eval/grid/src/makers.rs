//! [`Maker`]: makes the images that no node of the suite makes: merged captures, SPUD as published, and those of the scripts of the paper.

use modulo_msgs::std_msgs::{Header, Time};
use modulo_runtime::{
    Context, Flow, MessageKind, Node, ParameterError, Parameters, SensorModel, StampedFrame, StepError,
    Topic, Trigger,
};

use crate::GridError;
use crate::handed::{Handed, Make};
use crate::paper::SPUD_AS_PUBLISHED;
use crate::{bracket, paper};

/// The streams of the scripts of the paper.
pub const OF_PAPER: [&str; 4] = ["ideal", "saturated", "modulo", "recovered"];
/// The streams of merged captures: of frames that follow each other, and of a scene that stands still.
pub const BRACKETS: [&str; 2] = ["multi_exposure", "multi_exposure_still"];
/// The scripts of the paper with SPUD as published, and with SPUD made congruent.
pub const PAPER: [(&str, &str); 2] = [("paper_as_published", SPUD_AS_PUBLISHED), ("paper_spud", "spud")];

/// The method that a maker unwraps with.
pub fn method_of(executable: &str) -> Option<&'static str> {
    let paper = PAPER.iter().find(|(own, _)| *own == executable).map(|(_, method)| *method);
    paper.or((executable == SPUD_AS_PUBLISHED).then_some(SPUD_AS_PUBLISHED))
}

/// Whether a maker merges frames that follow each other.
pub fn needs_neighbours(executable: &str) -> bool {
    executable == BRACKETS[0]
}

/// The topics of a maker.
pub fn outputs(executable: &str) -> Vec<Topic> {
    let image = |name: &str| Topic::new(name, MessageKind::Image);
    match BRACKETS.iter().find(|stream| **stream == executable) {
        Some(stream) => vec![image(stream)],
        None if executable == SPUD_AS_PUBLISHED => vec![image("recovered")],
        None => OF_PAPER.map(image).into(),
    }
}

/// Makes the images of `executable` with `sensor` from the frames that come through `handed`.
pub struct Maker {
    make: Make,
    outputs: Vec<Topic>,
    seed: u64,
    handed: Handed,
}

impl Maker {
    /// Prepares the sensor.
    pub fn new(
        executable: &str,
        (sensor, seed): (&SensorModel, i64),
        handed: Handed,
    ) -> Result<Self, GridError> {
        let make = match PAPER.iter().find(|(own, _)| *own == executable) {
            Some((_, method)) => paper::maker(sensor, *method == SPUD_AS_PUBLISHED)?,
            None if executable == SPUD_AS_PUBLISHED => paper::published_spud(sensor)?,
            None => bracket::maker(sensor)?,
        };
        Ok(Self { make, outputs: outputs(executable), seed: seed.unsigned_abs(), handed })
    }
}

impl Node for Maker {
    fn inputs(&self) -> Vec<Topic> {
        Vec::new()
    }

    fn outputs(&self) -> Vec<Topic> {
        self.outputs.clone()
    }

    fn configure(&mut self, _: &Parameters) -> Result<(), ParameterError> {
        Ok(())
    }

    fn step(&mut self, _: Trigger, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        let Some(frame) = self.handed.take() else { return Ok(Flow::Done) };
        let header = Header { stamp: Time::from_ns(cx.now_ns()), ..Header::default() };
        // The noise of a frame is that of the other cells.
        let seed = self.seed.wrapping_add(frame.place as u64);
        for (output, topic) in self.outputs.iter().enumerate() {
            if cx.wanted(output) {
                let frame = (self.make)(&frame, seed, &topic.name, cx);
                let frame = frame.map_err(|why| StepError::Skip(why.to_string()))?;
                cx.emit(output, StampedFrame { header: header.clone(), frame });
            }
        }
        Ok(Flow::Continue)
    }
}
