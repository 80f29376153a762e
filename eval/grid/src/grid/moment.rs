//! [`Moment`]: a frame and what was there just before and just after it.

use modulo_bags::source::{SourceError, SourceFrame};
use ndarray::Array3;

use super::frames::{Frames, Raw};

/// A frame with its number.
pub struct Moment {
    /// Among the frames that are scored.
    pub number: usize,
    /// The frame.
    pub frame: SourceFrame,
    /// Radiance of the frame before and of the one after it, labelled or not; at the ends of a drive, of itself. `None`
    /// where nobody needs it.
    pub around: Option<[Array3<f32>; 2]>,
}

impl Moment {
    /// The frame for another way, without its neighbours.
    pub fn again(&self) -> Self {
        Self { number: self.number, frame: self.frame.clone(), around: None }
    }
}

/// Whether the neighbours are read as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Neighbours {
    /// They are.
    Kept,
    /// Each frame stands alone.
    Dropped,
}

/// The frames that are scored, in their order.
pub struct Moments<'a> {
    frames: &'a mut Frames,
    neighbours: Neighbours,
    /// Drive and radiance of the last frame.
    before: Option<(usize, Array3<f32>)>,
    ahead: Option<Raw>,
}

impl<'a> Moments<'a> {
    /// From the first frame on.
    ///
    /// # Errors
    /// [`SourceError`] when the data is no longer there.
    pub fn new(frames: &'a mut Frames, neighbours: Neighbours) -> Result<Self, SourceError> {
        frames.rewind()?;
        Ok(Self { frames, neighbours, before: None, ahead: None })
    }

    fn around(&self, raw: &Raw) -> Option<[Array3<f32>; 2]> {
        let own = &raw.frame.as_ref().ok()?.radiance;
        let fits = |drive: usize, other: &Array3<f32>| drive == raw.drive && other.dim() == own.dim();
        let before =
            self.before.as_ref().filter(|(drive, other)| fits(*drive, other)).map(|(_, other)| other);
        let after =
            self.ahead.as_ref().and_then(|ahead| Some((ahead.drive, &ahead.frame.as_ref().ok()?.radiance)));
        let after = after.filter(|(drive, other)| fits(*drive, other)).map(|(_, other)| other);
        Some([before.unwrap_or(own).clone(), after.unwrap_or(own).clone()])
    }
}

impl Iterator for Moments<'_> {
    type Item = Result<Moment, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let raw = self.ahead.take().or_else(|| self.frames.raw())?;
            let mut around = None;
            if self.neighbours == Neighbours::Kept {
                self.ahead = self.frames.raw();
                around = self.around(&raw);
                self.before = raw.frame.as_ref().ok().map(|frame| (raw.drive, frame.radiance.clone()));
            }
            if let Some(number) = self.frames.number_of(raw.place) {
                return Some(raw.frame.map(|frame| Moment { number, frame, around }));
            }
        }
    }
}
