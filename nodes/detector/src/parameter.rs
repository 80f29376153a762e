//! The parameters, and what they mean once they are read.

use std::path::PathBuf;

use modulo_runtime::parameter::Allowed;
use modulo_runtime::{Descriptor, Parameters, Refusal, Value};

use crate::classes::Classes;
use crate::engine::EngineChoice;
use crate::input_size::InputSize;
use crate::model::{DEMO, Layout};

/// The streams that have a short name.
const STREAMS: [&str; 4] = ["modulo", "recovered", "saturated", "ideal"];

/// The detector's parameters.
pub fn declare() -> Vec<Descriptor> {
    let text = |text: &str| Value::String(text.to_owned());
    vec![
        Descriptor::new(
            "model",
            text(DEMO),
            Allowed::Any,
            "Path of the ONNX model, or demo: the embedded demonstration, not for roads.",
        )
        .fixed(),
        Descriptor::new(
            "engine",
            text("auto"),
            Allowed::Words(EngineChoice::WORDS),
            "auto = ONNX Runtime (ort) where its library is found, else rten.",
        )
        .fixed(),
        Descriptor::new(
            "input",
            text("recovered"),
            Allowed::Any,
            "Stream to look at (the paper's p): modulo, recovered, saturated, ideal, or a topic from '/'.",
        ),
        Descriptor::new(
            "score_threshold",
            Value::Double(0.25),
            Allowed::Doubles { from: 0.0, to: 1.0 },
            "Detections below this score are not published.",
        ),
        Descriptor::new(
            "max_det",
            Value::Integer(300),
            Allowed::Integers { from: 1, to: 1000 },
            "At most so many detections a frame, the best ones.",
        ),
        Descriptor::new(
            "input_size",
            text("auto"),
            Allowed::Any,
            "Model input in px: auto (pad to multiples of 32, no resize) or WIDTHxHEIGHT (centred, never enlarged).",
        ),
        Descriptor::new(
            "classes",
            Value::Strings(Vec::new()),
            Allowed::Any,
            "Class names to publish, as called after class_map; empty = all.",
        ),
        Descriptor::new(
            "class_map",
            text(""),
            Allowed::Any,
            "Path of a file of lines 'from: to' that renames classes and drops all others; empty = none.",
        ),
        Descriptor::new(
            "threads",
            Value::Integer(0),
            Allowed::Integers { from: 0, to: 64 },
            "Threads of one inference; 0 = all cores.",
        )
        .fixed(),
        Descriptor::new(
            "bits",
            Value::Integer(0),
            Allowed::Integers { from: 0, to: 16 },
            "Bits of the sensor behind the image; 0 = the whole range of the encoding, 8 or 16.",
        ),
    ]
}

/// What is fixed at the start.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Startup {
    /// The model's file.
    pub model: PathBuf,
    /// The engine asked for.
    pub engine: EngineChoice,
    /// Threads asked for, 0 = all cores.
    pub threads: usize,
}

impl Startup {
    /// # Errors
    /// [`Refusal`] when no model is named.
    pub fn read(parameters: &Parameters) -> Result<Self, Refusal> {
        let model = parameters.string("model");
        if model.is_empty() {
            let why = "must be demo, or the path of an ONNX detector, such as model:=/data/yolov10n.onnx";
            return Err(Refusal::new("model", "''", why));
        }
        let engine = parameters.string("engine");
        let engine = EngineChoice::from_word(engine).ok_or_else(|| {
            Refusal::new("engine", engine, format!("must be one of {}", EngineChoice::WORDS.join(", ")))
        })?;
        let threads = usize::try_from(parameters.integer("threads")).unwrap_or(0);
        Ok(Self { model: PathBuf::from(model), engine, threads })
    }
}

/// What may change between two frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// A stream's name or an absolute topic.
    pub input: String,
    /// Least score, in [0, 1].
    pub score_threshold: f32,
    /// Most detections of a frame, at least 1.
    pub max_det: usize,
    /// Size of the model's input.
    pub input_size: InputSize,
    /// Names to publish.
    pub classes: Classes,
    /// Sensor bits, 0 = the encoding's.
    pub bits: u8,
}

impl Settings {
    /// Reads the parameters for a model of this `layout`.
    ///
    /// # Errors
    /// [`Refusal`] of the first one that is not possible.
    pub fn read(parameters: &Parameters, layout: &Layout) -> Result<Self, Refusal> {
        let size = parameters.string("input_size");
        Ok(Self {
            input: input(parameters.string("input"))?,
            score_threshold: parameters.double("score_threshold") as f32,
            max_det: usize::try_from(parameters.integer("max_det")).unwrap_or(1),
            input_size: InputSize::parse(size, layout.size)
                .map_err(|why| Refusal::new("input_size", size, why))?,
            classes: Classes::new(
                &layout.names,
                parameters.string("class_map"),
                parameters.strings("classes"),
            )?,
            bits: u8::try_from(parameters.integer("bits")).unwrap_or(0),
        })
    }
}

fn input(name: &str) -> Result<String, Refusal> {
    if STREAMS.contains(&name) || is_topic(name) {
        return Ok(name.to_owned());
    }
    let why =
        format!("must be one of {}, or an absolute topic such as /camera/image_raw", STREAMS.join(", "));
    Err(Refusal::new("input", name, why))
}

/// Whether `name` is an absolute ROS 2 topic name.
fn is_topic(name: &str) -> bool {
    let token = |token: &str| {
        token.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
            && token.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '_')
    };
    name.strip_prefix('/').is_some_and(|tokens| tokens.split('/').all(token))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_default_is_allowed() {
        for descriptor in declare() {
            assert_eq!(descriptor.accept(descriptor.default.clone()), Ok(descriptor.default.clone()));
        }
    }

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
