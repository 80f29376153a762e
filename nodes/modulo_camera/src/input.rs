//! [`CameraInput`]: the source of the camera's radiance.

use modulo_bags::source::{self, Source, SourceFrame, SourceOptions};
use modulo_images::White;
use modulo_runtime::{ParameterError, StepError};

use crate::parameters::CameraParameters;

/// A source of frames, or a topic that brings them.
pub enum CameraInput {
    /// Read frame by frame.
    Frames(FrameReader),
    /// Brought by a topic.
    Topic {
        /// Name of the topic.
        name: String,
        /// The scale of its float images.
        white: White,
    },
}

/// A source that is read once or again and again.
pub struct FrameReader {
    source: Box<dyn Source>,
    repeat: bool,
    /// Whether a frame of this round was good.
    given: bool,
    /// The fault of the last bad frame.
    bad: Option<String>,
}

impl CameraInput {
    /// Opens the source that the parameter `source` names.
    pub fn open(parameters: &CameraParameters) -> Result<Self, ParameterError> {
        let (spec, white) = (&parameters.source, parameters.white as f32);
        if let Some(name) = spec.strip_prefix("topic:") {
            let white =
                White::new(white).map_err(|why| ParameterError::new("white", white, why.to_string()))?;
            return Ok(Self::Topic { name: name.to_owned(), white });
        }
        let topic = Some(parameters.source_topic.clone()).filter(|t| !t.is_empty());
        let options = SourceOptions { white, topic };
        let source = source::open(spec, &options)
            .map_err(|why| ParameterError::new("source", spec, why.to_string()))?;
        Ok(Self::Frames(FrameReader::new(source, parameters.r#loop)))
    }
}

impl FrameReader {
    /// Returns the frames of `source` from its first one on; after its last one it is over, or starts again.
    pub fn new(source: Box<dyn Source>, repeat: bool) -> Self {
        Self { source, repeat, given: false, bad: None }
    }

    /// Returns the next frame; `None` at the end.
    ///
    /// # Errors
    /// [`StepError::Skip`] for a frame that cannot be read, [`StepError::Fatal`] when the source is over and no frame
    /// of it was good, or when it cannot start again.
    pub fn next_frame(&mut self) -> Result<Option<SourceFrame>, StepError> {
        let mut next = self.source.next();
        if next.is_none() {
            if let (false, Some(why)) = (self.given, self.bad.take()) {
                return Err(StepError::Fatal(format!("no frame of the source is good: {why}")));
            }
            if self.repeat {
                self.source.rewind().map_err(|why| StepError::Fatal(why.to_string()))?;
                self.given = false;
                next = self.source.next();
            }
        }
        next.transpose().map_err(|why| self.refuse(why.to_string()))
    }

    /// Books that the last frame was good.
    pub fn accept(&mut self) {
        self.given = true;
    }

    /// Notes the fault of the last frame, and returns the error that skips it.
    pub fn refuse(&mut self, why: String) -> StepError {
        self.bad = Some(why.clone());
        StepError::Skip(why)
    }

    /// Goes on behind the first `frames` frames, good and bad ones, of all rounds.
    pub fn skip(&mut self, frames: u64) {
        let round = self.source.len().map(|frames| frames as u64).filter(|frames| self.repeat && *frames > 0);
        self.source.skip(round.map_or(frames, |round| frames % round));
        self.given = frames > 0;
    }
}
