//! [`HandedFrame`]: a frame on its way through [`Handed`] to a camera, or to a node in its place.

use std::sync::{Arc, Mutex, PoisonError};

use modulo_bags::source::{Frames, SourceError, SourceFrame};

/// A frame on its way to a camera.
#[derive(Clone, Debug)]
pub struct HandedFrame {
    /// Index over all drives.
    pub place: usize,
    /// Index of the drive.
    pub drive: usize,
    /// The frame.
    pub frame: SourceFrame,
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

impl Frames for Handed {
    fn next(&mut self) -> Option<Result<SourceFrame, SourceError>> {
        self.take().map(|handed| Ok(handed.frame))
    }

    /// The frames before are not read here.
    fn pass(&mut self, _: u64) {}

    fn rewind(&mut self) {}
}
