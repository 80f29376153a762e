//! Where the camera's radiance comes from.

use modulo_bags::source::{self, Source, SourceError, SourceFrame, SourceOptions};
use modulo_core::Frame;
use modulo_runtime::Refusal;
use ndarray::Array3;

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
    /// Brought by this topic.
    Topic(String),
}

impl Feed {
    /// Opens what the parameter `source` names.
    pub fn open(parameters: &CameraParameters) -> Result<Self, Refusal> {
        let spec = &parameters.source;
        if let Some(name) = spec.strip_prefix("topic:") {
            return Ok(Self::Topic(name.to_owned()));
        }
        let topic = Some(parameters.source_topic.clone()).filter(|t| !t.is_empty());
        let options = SourceOptions { white: parameters.white as f32, topic };
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

/// Radiance of a running stack's image: the fraction `v / 2^depth` of its
/// sample range, `H x W x C` in `[0, 1)`.
pub fn radiance(frame: &Frame) -> Array3<f32> {
    let scale = 1.0 / f32::from(frame.depth()).exp2();
    let mut radiance = frame.to_f32();
    radiance.map_inplace(|v| *v *= scale);
    radiance
}
