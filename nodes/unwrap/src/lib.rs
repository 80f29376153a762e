//! The `unwrap` node: a modulo image in, the recovered image out, 8 bit for a
//! detector, sharpened on request, and 16 bit in counts (HDR), exactly
//! what the sensor saw, for whoever wants the radiance.
//!
//! The header of the modulo image is copied. The node never guesses the sensor:
//! its model is a group of parameters, as in the camera. What it thinks of each frame
//! goes to `/diagnostics`.

mod parameters;
mod recovery;

use std::sync::Arc;

use modulo_core::deblur::Deblur;
use modulo_core::unwrap::{Recovered, Unwrap};
use modulo_core::{Frame, Range, tone};
use modulo_msgs::std_msgs::Header;
use modulo_runtime::{
    Context, Cue, Flow, Message, MessageKind, Node, Parameters, Refusal, StampedFrame, StepError, Topic,
};
use recovery::Tally;

pub use parameters::UnwrapParameters;

/// Output indices, in the order of [`Node::outputs`].
const RECOVERED: usize = 0;
const HDR: usize = 1;
const DIAGNOSTICS: usize = 2;

/// The node's step.
pub struct UnwrapNode {
    method: Box<dyn Unwrap>,
    range: Range,
    /// Removes the blur of the lens from `recovered`, if that is requested.
    deblur: Option<Deblur>,
    recovered: Recovered,
    tally: Tally,
}

impl UnwrapNode {
    /// Prepares the method that the parameters name.
    ///
    /// # Errors
    /// [`Refusal`] with the parameter that is not possible.
    pub fn new(parameters: &UnwrapParameters) -> Result<Self, Refusal> {
        Ok(Self {
            method: parameters.method()?,
            range: parameters.sensor.range()?,
            deblur: parameters.blur().map(Deblur::new),
            recovered: Recovered::default(),
            tally: Tally::default(),
        })
    }

    fn unwrap(&mut self, modulo: &StampedFrame, cx: &mut Context<'_>) -> Result<(), StepError> {
        let skip = |why: String| StepError::Skip(why);
        cx.stage("unwrap", || self.method.unwrap(&modulo.frame, self.range, &mut self.recovered))
            .map_err(|why| skip(why.to_string()))?;
        self.tally.count(&self.recovered.report);
        if cx.wanted(DIAGNOSTICS) {
            let said = recovery::describe(&modulo.header, self.method.name(), &self.recovered.report);
            cx.emit(DIAGNOSTICS, Message::Diagnostics(Arc::new(said)));
        }
        if cx.wanted(RECOVERED) {
            let x = &self.recovered.x;
            let frame = match &mut self.deblur {
                None => cx.stage("tone", || tone::linear8(x, self.range)),
                Some(deblur) => cx.stage("deblur", || deblur.linear8(x, self.range)),
            };
            let frame = frame.map_err(|why| skip(why.to_string()))?;
            cx.emit(RECOVERED, stamped(&modulo.header, frame));
        }
        if cx.wanted(HDR) {
            let frame = tone::counts16(&self.recovered.x).map_err(|why| skip(why.to_string()))?;
            cx.emit(HDR, stamped(&modulo.header, frame));
        }
        Ok(())
    }
}

fn stamped(header: &Header, frame: Frame) -> Message {
    Message::Image(Arc::new(StampedFrame { header: header.clone(), frame }))
}

impl Node for UnwrapNode {
    fn inputs(&self) -> Vec<Topic> {
        vec![Topic::new("modulo", MessageKind::Image)]
    }

    fn outputs(&self) -> Vec<Topic> {
        vec![
            Topic::new("recovered", MessageKind::Image),
            Topic::new("hdr", MessageKind::Image),
            Topic::new("/diagnostics", MessageKind::Diagnostics),
        ]
    }

    fn configure(&mut self, parameters: &Parameters) -> Result<(), Refusal> {
        let Self { method, range, deblur, .. } = Self::new(&parameters.into())?;
        (self.method, self.range, self.deblur) = (method, range, deblur);
        Ok(())
    }

    fn step(&mut self, cue: Cue, cx: &mut Context<'_>) -> Result<Flow, StepError> {
        if let Cue::Message { message: Message::Image(modulo), .. } = cue
            && (cx.wanted(RECOVERED) || cx.wanted(HDR))
        {
            self.unwrap(&modulo, cx)?;
        }
        Ok(Flow::Continue)
    }

    fn facts(&self) -> Vec<(&'static str, String)> {
        let mut facts = vec![("method", self.method.name().to_owned())];
        facts.extend(self.tally.facts());
        facts
    }
}
