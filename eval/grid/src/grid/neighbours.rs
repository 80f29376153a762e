//! [`FrameWithNeighbours`]: a frame with the frames before and after it.

use modulo_bags::source::{SourceError, SourceFrame};
use ndarray::Array3;

use super::frames::{Frames, Raw};

/// A frame that is scored.
#[derive(Clone)]
pub struct FrameWithNeighbours {
    /// Number among the frames that are scored.
    pub number: usize,
    /// The frame.
    pub frame: SourceFrame,
    /// Radiance of the frames before and after it, with or without labels. At the ends of a drive the frame itself stands
    /// in. `None` if no pipeline needs it.
    pub around: Option<[Array3<f32>; 2]>,
}

/// Whether the neighbours are read as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Neighbours {
    /// Every frame comes with its neighbours.
    Kept,
    /// Frames come without neighbours.
    Dropped,
}

/// Iterates over the frames that are scored, in their order.
pub struct FramesWithNeighbours<'a> {
    frames: &'a mut Frames,
    neighbours: Neighbours,
    /// Drive and radiance of the frame before.
    before: Option<(usize, Array3<f32>)>,
    ahead: Option<Raw>,
}

impl<'a> FramesWithNeighbours<'a> {
    /// Starts at the first frame.
    pub fn new(frames: &'a mut Frames, neighbours: Neighbours) -> Result<Self, SourceError> {
        frames.rewind()?;
        Ok(Self { frames, neighbours, before: None, ahead: None })
    }

    fn around(&self, raw: &Raw) -> Option<[Array3<f32>; 2]> {
        let own = &raw.frame.as_ref().ok()?.radiance;
        // Frames of another drive show another scene, and captures of different sizes cannot be merged.
        let fits = |drive: usize, other: &Array3<f32>| drive == raw.drive && other.dim() == own.dim();
        let before =
            self.before.as_ref().filter(|(drive, other)| fits(*drive, other)).map(|(_, other)| other);
        let after =
            self.ahead.as_ref().and_then(|ahead| Some((ahead.drive, &ahead.frame.as_ref().ok()?.radiance)));
        let after = after.filter(|(drive, other)| fits(*drive, other)).map(|(_, other)| other);
        Some([before.unwrap_or(own).clone(), after.unwrap_or(own).clone()])
    }
}

impl Iterator for FramesWithNeighbours<'_> {
    type Item = Result<FrameWithNeighbours, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let raw = self.ahead.take().or_else(|| self.frames.raw())?;
            let mut around = None;
            // One frame is read ahead. It is kept in `ahead`, because a source is read only forwards.
            if self.neighbours == Neighbours::Kept {
                self.ahead = self.frames.raw();
                around = self.around(&raw);
                self.before = raw.frame.as_ref().ok().map(|frame| (raw.drive, frame.radiance.clone()));
            }
            if let Some(number) = self.frames.number_of(raw.place) {
                return Some(raw.frame.map(|frame| FrameWithNeighbours { number, frame, around }));
            }
        }
    }
}
