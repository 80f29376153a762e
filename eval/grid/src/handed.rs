//! [`HandedFrame`]: a frame with the frames before and after it, on its way through [`Handed`] to a camera or to a [`Make`].

use std::sync::{Arc, Mutex, PoisonError};

use modulo_bags::source::{Source, SourceError, SourceFrame};
use modulo_core::Frame;
use modulo_runtime::Context;
use ndarray::Array3;

use crate::GridError;

/// Makes the image of a stream of a frame with noise of a seed.
pub type Make = Box<dyn FnMut(&HandedFrame, u64, &str, &mut Context<'_>) -> Result<Frame, GridError> + Send>;

/// A frame on its way to a camera.
#[derive(Clone, Debug)]
pub struct HandedFrame {
    /// Index over all drives.
    pub place: usize,
    /// Index of the drive.
    pub drive: usize,
    /// The frame.
    pub frame: SourceFrame,
    /// Radiance of the frames before and after it. At the ends of a drive the frame itself stands in. `None` if no camera needs it.
    pub around: Option<[Array3<f32>; 2]>,
}

/// The place through which a frame goes to a camera.
#[derive(Clone, Default)]
pub struct Handed(Arc<Mutex<Option<HandedFrame>>>);

impl Handed {
    /// Lays the frame down.
    pub fn hand(&self, frame: HandedFrame) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(frame);
    }

    /// Takes the frame.
    pub fn take(&self) -> Option<HandedFrame> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

impl Source for Handed {
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        self.take().map(|handed| Ok(handed.frame))
    }

    /// The frames before are not read here.
    fn skip(&mut self, _: u64) {}

    fn len(&self) -> Option<usize> {
        None
    }

    fn rewind(&mut self) -> Result<(), SourceError> {
        Ok(())
    }
}
