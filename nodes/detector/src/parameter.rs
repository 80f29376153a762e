//! The parameters of the `detector` node, and their check against a model.

use std::path::Path;

use modulo_runtime::{NodeName, ParameterError, ParameterSet as _};

use crate::classes::Classes;
use crate::engine::EngineChoice;
use crate::input_size::InputSize;
use crate::model::{DEMO, ModelLayout};

/// The streams that have a short name.
const STREAMS: [&str; 4] = ["modulo", "recovered", "saturated", "ideal"];

modulo_runtime::parameters! {
    /// The parameters of the `detector` node.
    pub struct DetectorParameters {
        /// Path of the ONNX model, or demo for the embedded demonstration model, which is not made for roads.
        model: String = DEMO.to_owned(),
        /// Inference engine. auto takes ONNX Runtime (ort) where its library is found, and rten elsewhere.
        engine: EngineChoice = EngineChoice::Auto => EngineChoice::WORDS,
        /// Stream that the detector reads (the paper's p): modulo, recovered, saturated, ideal, or an absolute topic
        /// such as /camera/image_raw.
        input: String = "recovered".to_owned(),
        /// Detections with a lower score are not published.
        score_threshold: f64 = 0.25 => 0.0..=1.0,
        /// Largest number of detections of a frame. Those with the best scores are kept.
        max_det: usize = 300 => 1..=1000,
        /// Size of the model's input in px: auto (padded to multiples of 32, never resized) or WIDTHxHEIGHT (centred,
        /// never enlarged).
        input_size: String = "auto".to_owned(),
        /// Names of the classes to publish, as they are called after class_map. Empty: all classes.
        classes: Vec<String> = Vec::new(),
        /// Path of a file with lines 'from: to' that renames classes and drops all others. Empty: no renaming.
        class_map: String = String::new(),
        /// Number of threads of one inference. 0: as many as the machine has cores.
        threads: usize = 0 => 0..=64,
        /// Bits of the sensor that made the image. 0: those of the camera's sensor description, and without one the
        /// whole range of the encoding, 8 or 16 bits.
        bits: u8 = 0 => 0..=16,
    }
}

impl DetectorParameters {
    /// Returns the path of the model.
    pub(crate) fn model(&self) -> Result<&Path, ParameterError> {
        self.check()?;
        if self.model.is_empty() {
            let why = "must be demo, or the path of an ONNX detector, such as model:=/data/yolov10n.onnx";
            return Err(ParameterError::new("model", "''", why));
        }
        Ok(Path::new(&self.model))
    }

    /// Returns whether `other` needs the same loaded model.
    pub(crate) fn same_engine(&self, other: &Self) -> bool {
        (&self.model, self.engine, self.threads) == (&other.model, other.engine, other.threads)
    }
}

/// The settings that may change between two frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// A stream's name or an absolute topic.
    pub input: String,
    /// Smallest score, in [0, 1].
    pub score_threshold: f32,
    /// Largest number of detections of a frame, at least 1.
    pub max_det: usize,
    /// Size of the model's input.
    pub input_size: InputSize,
    /// Classes to publish.
    pub classes: Classes,
    /// Sensor bits, 0 = the encoding's.
    pub bits: u8,
}

impl Settings {
    /// Returns the settings that the parameters give for a model of this `layout`; `last` are the settings until now.
    ///
    /// # Errors
    /// [`ParameterError`] of the first one that is not possible.
    pub fn new(
        parameters: &DetectorParameters,
        layout: &ModelLayout,
        last: Option<&Self>,
    ) -> Result<Self, ParameterError> {
        parameters.check()?;
        let (size, classes) = (&parameters.input_size, last.map(|last| &last.classes));
        Ok(Self {
            input: input(&parameters.input)?,
            score_threshold: parameters.score_threshold as f32,
            max_det: parameters.max_det,
            input_size: InputSize::parse(size, layout.size)
                .map_err(|why| ParameterError::new("input_size", size, why))?,
            classes: Classes::new(&layout.names, &parameters.class_map, &parameters.classes, classes)?,
            bits: parameters.bits,
        })
    }
}

fn input(name: &str) -> Result<String, ParameterError> {
    if STREAMS.contains(&name) || (name.starts_with('/') && NodeName::default().resolve(name).is_ok()) {
        return Ok(name.to_owned());
    }
    let why =
        format!("must be one of {}, or an absolute topic such as /camera/image_raw", STREAMS.join(", "));
    Err(ParameterError::new("input", name, why))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_input_is_a_stream_or_a_topic() {
        for possible in ["modulo", "recovered", "saturated", "ideal", "/image", "/camera/image_raw", "/_a/b2"]
        {
            assert_eq!(input(possible).as_deref(), Ok(possible));
        }
        for bad in ["", "p", "Recovered", "image", "/", "//a", "/a/", "/a b", "/2a", "~/a"] {
            let why = input(bad).expect_err(bad).to_string();
            assert!(why.contains("modulo, recovered, saturated, ideal") && why.contains("absolute"), "{why}");
        }
    }
}
