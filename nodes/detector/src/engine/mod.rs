//! Inference engines behind one trait, and the choice among them.
//!
//! An engine knows tensors, but no images, parameters or messages. A requested engine is used or refused; only `auto` chooses, and it reports its choice.

mod onnxruntime;
mod rten;

use std::fmt;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use ndarray::{Array2, ArrayView4};

use crate::model::{ModelLayout, TensorSpec, embedded};

/// A loaded model, ready to run.
pub trait Engine: Send {
    /// Runs the model on `input`, `1 x 3 x H x W`, RGB in `[0, 1]`, contiguous. Gives N x 6 rows of x1, y1, x2, y2,
    /// score, class in input pixels.
    ///
    /// # Errors
    /// [`EngineError::Run`] when the model cannot work on this input.
    fn run(&mut self, input: ArrayView4<'_, f32>) -> Result<Array2<f32>, EngineError>;
}

/// The requested engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EngineChoice {
    /// ONNX Runtime where its library is found, else rten.
    Auto,
    /// ONNX Runtime or an error.
    OnnxRuntime,
    /// rten, pure Rust, always there.
    Rten,
}

impl EngineChoice {
    /// Every choice with its word, as the parameter `engine` has it.
    pub const WORDS: [(&'static str, Self); 3] =
        [("auto", Self::Auto), ("ort", Self::OnnxRuntime), ("rten", Self::Rten)];
}

impl fmt::Display for EngineChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = Self::WORDS.iter().find(|(_, choice)| choice == self).map(|(word, _)| *word);
        f.write_str(word.expect("every choice has a word"))
    }
}

/// Error: a model does not run.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EngineError {
    /// ONNX Runtime was asked for and is not there.
    #[error(
        "engine 'ort': no ONNX Runtime library found; looked at {0}; \
         install one (pip install onnxruntime) and set ORT_DYLIB_PATH to its libonnxruntime.so, \
         or set engine to rten"
    )]
    NoLibrary(String),
    /// The file is not there, not readable or not a model of this engine.
    #[error("model '{model}': {engine} cannot load it: {why}")]
    Load {
        /// Path of the model.
        model: String,
        /// The engine that tried.
        engine: &'static str,
        /// The error of the engine.
        why: String,
    },
    /// The file is a model, but not a detector that this node can read.
    #[error("model '{model}': {found}, needed is {needed}")]
    Shape {
        /// Path of the model.
        model: String,
        /// The shape of the model.
        found: String,
        /// The shape that is needed.
        needed: &'static str,
    },
    /// The model failed on an input.
    #[error("{engine} failed on a {height} x {width} input: {why}")]
    Run {
        /// Name of the engine.
        engine: &'static str,
        /// Number of rows of the input.
        height: usize,
        /// Number of columns of the input.
        width: usize,
        /// The error of the engine.
        why: String,
    },
}

impl EngineError {
    fn load(model: &Path, engine: &'static str, why: impl fmt::Display) -> Self {
        Self::Load { model: model.display().to_string(), engine, why: one_line(why) }
    }

    fn run(engine: &'static str, input: ArrayView4<'_, f32>, why: impl fmt::Display) -> Self {
        let (_, _, height, width) = input.dim();
        Self::Run { engine, height, width, why: one_line(why) }
    }
}

/// Engines like to answer in paragraphs; a log wants one line.
fn one_line(text: impl fmt::Display) -> String {
    text.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The inputs, outputs and class names of a model, as an engine reads them.
pub struct Signature {
    /// Inputs without the initialisers.
    pub inputs: Vec<TensorSpec>,
    /// Outputs in the file's order.
    pub outputs: Vec<TensorSpec>,
    /// Metadata property `names`, a Python dict as text.
    pub names: Option<String>,
}

/// An engine that runs, and how it came to be the one.
pub struct OpenedEngine {
    /// The engine.
    pub engine: Box<dyn Engine>,
    /// Name of the engine, `ort` or `rten`.
    pub name: &'static str,
    /// Input and output of the model.
    pub layout: ModelLayout,
    /// Path of the library, or the reason why `auto` took rten.
    pub note: String,
}

/// Returns the path of the ONNX Runtime library that `auto` takes.
///
/// # Errors
/// [`EngineError::NoLibrary`]: `auto` takes rten.
pub fn onnxruntime_library() -> Result<String, EngineError> {
    onnxruntime::library().map(|found| found.place)
}

/// Returns the places where ONNX Runtime is looked for, in order; one without a folder is left to the system's loader.
pub fn onnxruntime_places() -> Vec<PathBuf> {
    onnxruntime::places_here()
}

/// Loads `model` with the engine asked for. `auto` falls back to rten when no library is found, never because a model
/// does not load.
pub fn open(model: &Path, choice: EngineChoice, threads: NonZeroUsize) -> Result<OpenedEngine, EngineError> {
    // A missing file is the most common mistake, and both engines describe it at length.
    if embedded(model).is_none() {
        std::fs::File::open(model).map_err(|error| EngineError::load(model, "the system", error))?;
    }
    let with_rten = |note| {
        let (engine, layout) = self::rten::Rten::load(model, threads)?;
        Ok(OpenedEngine { engine: Box::new(engine), name: self::rten::NAME, layout, note })
    };
    if choice == EngineChoice::Rten {
        return with_rten("as asked".to_owned());
    }
    match onnxruntime::library() {
        Ok(found) => {
            let (engine, layout) = onnxruntime::OnnxRuntime::load(model, threads, &found)?;
            let engine = Box::new(engine);
            Ok(OpenedEngine { engine, name: onnxruntime::NAME, layout, note: found.place })
        }
        Err(error) if choice == EngineChoice::OnnxRuntime => Err(error),
        Err(error) => {
            tracing::debug!("detector takes rten, {error}");
            with_rten("auto: no ONNX Runtime library found".to_owned())
        }
    }
}
