//! Where the camera's radiance comes from.

use modulo_bags::source::{self, Source, SourceError, SourceFrame, SourceOptions};
use modulo_images::White;
use modulo_runtime::Refusal;

use crate::parameters::CameraParameters;

/// A source of frames, or a topic that brings them.
pub enum Feed {
    /// Read frame by frame.
    Frames {
        /// What is read.
        source: Box<dyn Source>,
        /// Whether it starts again at its end.
        repeat: bool,
    },
    /// Brought by a topic.
    Topic {
        /// Name of the topic.
        name: String,
        /// What its float images are scaled by.
        white: White,
    },
}

impl Feed {
    /// Opens what the parameter `source` names.
    pub fn open(parameters: &CameraParameters) -> Result<Self, Refusal> {
        let (spec, white) = (&parameters.source, parameters.white as f32);
        if let Some(name) = spec.strip_prefix("topic:") {
            let white = White::new(white).map_err(|why| Refusal::new("white", white, why.to_string()))?;
            return Ok(Self::Topic { name: name.to_owned(), white });
        }
        let topic = Some(parameters.source_topic.clone()).filter(|t| !t.is_empty());
        let options = SourceOptions { white, topic };
        let source =
            source::open(spec, &options).map_err(|why| Refusal::new("source", spec, why.to_string()))?;
        Ok(Self::Frames { source, repeat: parameters.r#loop })
    }

    /// The next frame; `None` at the end, and always for a topic.
    pub fn next_frame(&mut self) -> Result<Option<SourceFrame>, SourceError> {
        let Self::Frames { source, repeat } = self else { return Ok(None) };
        match source.next() {
            None if *repeat => {
                source.rewind()?;
                source.next().transpose()
            }
            frame => frame.transpose(),
        }
    }
}
