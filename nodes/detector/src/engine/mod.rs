//! Inference engines behind one trait, and the choice among them.
//!
//! An engine knows tensors, but no images, parameters or messages. A requested engine is used or refused; only `auto` chooses, and it reports its choice.

mod nvidia;
mod onnxruntime;
mod rten;
mod shared;
mod weights;

use std::fmt;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use modulo_runtime::warn_once;
use ndarray::{Array2, Array4, ArrayView4};

use crate::head::Head;
use crate::model::{ModelLayout, embedded};
use crate::plausible::{contradiction, unnamed_classes};
pub use nvidia::{gpus, libraries as gpu_libraries};
pub use onnxruntime::places_here as onnxruntime_places;
pub use shared::SharedEngine;
use weights::ModelFile;

/// A loaded model, ready to run.
pub trait Engine: Send {
    /// Runs the model on `input`, `1 x 3 x H x W`, RGB in `[0, 1]`, contiguous. Gives its output without the first side, which is 1.
    fn run(&mut self, input: ArrayView4<'_, f32>) -> Result<Array2<f32>, EngineError>;
}

/// The requested engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EngineChoice {
    /// ONNX Runtime where its library is found, else rten.
    Auto,
    /// ONNX Runtime or an error.
    OnnxRuntime,
    /// ONNX Runtime with OpenVINO's kernels for the processor, or an error; 16 bits (bf16) where the processor has them.
    OpenVino,
    /// The same with 32 bits on every processor.
    OpenVinoF32,
    /// rten, pure Rust, always there.
    Rten,
}

impl EngineChoice {
    /// Every choice with its word, as the parameter `engine` has it.
    pub const WORDS: [(&'static str, Self); 5] = [
        ("auto", Self::Auto),
        (onnxruntime::NAME, Self::OnnxRuntime),
        (onnxruntime::OPENVINO, Self::OpenVino),
        (onnxruntime::OPENVINO_F32, Self::OpenVinoF32),
        (self::rten::NAME, Self::Rten),
    ];

    /// Returns its word.
    pub fn word(self) -> &'static str {
        let word = Self::WORDS.iter().find(|(_, choice)| *choice == self).map(|(word, _)| *word);
        word.expect("every choice has a word")
    }
}

/// The processor or GPU that runs a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EngineDevice {
    /// The processor.
    Cpu,
    /// The NVIDIA GPU with this number, by CUDA.
    Cuda(u8),
    /// The NVIDIA GPU with this number, by TensorRT with numbers of 16 bits.
    TensorRt(u8),
}

impl fmt::Display for EngineDevice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => f.write_str("cpu"),
            Self::Cuda(number) => write!(f, "cuda:{number}"),
            Self::TensorRt(number) => write!(f, "tensorrt:{number}"),
        }
    }
}

impl FromStr for EngineDevice {
    type Err = String;

    /// Reads `cpu`, `cuda` or `tensorrt`, the last two with or without the number of a GPU, as in `cuda:1`.
    fn from_str(text: &str) -> Result<Self, String> {
        let (kind, number) = text.split_once(':').unwrap_or((text, "0"));
        match (kind, number.parse()) {
            _ if text == "cpu" => Ok(Self::Cpu),
            ("cuda", Ok(number)) => Ok(Self::Cuda(number)),
            ("tensorrt", Ok(number)) => Ok(Self::TensorRt(number)),
            _ => Err("must be cpu, cuda, tensorrt, or one of the last two with the number of a GPU, such as cuda:1".into()),
        }
    }
}

/// How cuDNN chooses the algorithms that run a model on [`EngineDevice::Cuda`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CudnnSearch {
    /// By rules.
    Heuristic,
    /// By a trial of all of them at each size of the input.
    Exhaustive,
}

impl CudnnSearch {
    /// Every choice with its word, as the parameter `cudnn_search` has it.
    pub const WORDS: [(&'static str, Self); 2] =
        [("heuristic", Self::Heuristic), ("exhaustive", Self::Exhaustive)];
}

/// An engine, and where and how it runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EngineOptions {
    /// The requested engine.
    pub engine: EngineChoice,
    /// The device that runs the model.
    pub device: EngineDevice,
    /// The choice of its algorithms on [`EngineDevice::Cuda`].
    pub cudnn_search: CudnnSearch,
    /// Number of threads of one inference on the processor. 0: as many as the machine has cores.
    pub threads: usize,
}

impl EngineOptions {
    /// Returns the number of threads, or as many as the machine runs at once for 0.
    pub fn cores(self) -> NonZeroUsize {
        NonZeroUsize::new(self.threads)
            .or_else(|| std::thread::available_parallelism().ok())
            .unwrap_or(NonZeroUsize::MIN)
    }
}

/// Error: a model does not run, or is no detector that this node can read. The text says why, with a remedy where there is one.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct EngineError(pub(crate) String);

impl EngineError {
    fn load(model: &Path, engine: &'static str, why: impl fmt::Display) -> Self {
        Self(format!("model '{}': {engine} cannot load it: {}", model.display(), one_line(why)))
    }

    fn read(model: &Path, why: impl fmt::Display) -> Self {
        Self(format!("model '{}': {}", model.display(), one_line(why)))
    }

    fn run(engine: &'static str, input: ArrayView4<'_, f32>, why: impl fmt::Display) -> Self {
        let (_, _, height, width) = input.dim();
        Self(format!("{engine} failed on a {height} x {width} input: {}", one_line(why)))
    }
}

/// Engines like to answer in paragraphs; a log wants one line.
fn one_line(text: impl fmt::Display) -> String {
    text.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}

/// An engine that runs, and how it came to be the one.
#[derive(Clone)]
pub struct OpenedEngine {
    pub engine: SharedEngine,
    /// Name of the engine, as the parameter `engine` has it.
    pub name: &'static str,
    /// Number of threads of one inference on the processor.
    pub threads: NonZeroUsize,
    /// Input and output of the model.
    pub layout: ModelLayout,
    /// Path of the library, or the reason for rten.
    pub note: String,
    /// Whether the first run at each size of the input takes seconds, as on a GPU, where the fastest kernels are searched for.
    pub searches: bool,
}

impl OpenedEngine {
    /// Runs the model on a black image of (height, width), so that the next run at this size is as fast as all others.
    ///
    /// # Errors
    /// [`EngineError`] where the model does not run.
    pub fn warm_up(&mut self, (height, width): (usize, usize)) -> Result<Array2<f32>, EngineError> {
        self.engine.run(Array4::zeros((1, 3, height, width)).view())
    }

    /// Runs `model`, from which this engine was made, for the first time, at (height, width). Returns the form of its output.
    ///
    /// # Errors
    /// [`EngineError`] where the model does not run, and where its output has no known form or cannot be boxes.
    pub fn first_run(&mut self, model: &Path, size: (usize, usize)) -> Result<Head, EngineError> {
        let output = self.warm_up(size)?;
        let refuse = |why| EngineError::read(model, why);
        let (names, end_to_end) = (&self.layout.names, self.layout.end_to_end);
        let head = Head::of(output.dim(), size, (end_to_end, names.count())).map_err(refuse)?;
        if let Some(why) = contradiction(head, &output, size) {
            return Err(refuse(format!("its output cannot be {head}: {why}")));
        }
        let doubts =
            [head.doubt(output.dim(), size, end_to_end), unnamed_classes(head, &output, names.count())];
        for doubt in doubts.into_iter().flatten() {
            warn_once(format!("model '{}': {doubt}", model.display()));
        }
        Ok(head)
    }
}

/// Returns the path of the ONNX Runtime library that `auto` takes.
///
/// # Errors
/// [`EngineError`] when there is none: `auto` takes rten.
pub fn onnxruntime_library() -> Result<String, EngineError> {
    onnxruntime::library().map(|found| found.place)
}

/// Returns the bytes of `model` and of the files with its weights, each with the path of the file. All of them together are the
/// model.
///
/// # Errors
/// [`EngineError`] when one of them cannot be read.
pub fn model_parts(model: &Path) -> Result<Vec<(PathBuf, Vec<u8>)>, EngineError> {
    file(model).map(|file| file.parts)
}

/// Reads `model` with its weights.
fn file(model: &Path) -> Result<ModelFile, EngineError> {
    if let Some(bytes) = embedded(model) {
        return Ok(ModelFile { whole: bytes.to_vec(), parts: vec![(model.to_owned(), bytes.to_vec())] });
    }
    let file = weights::read(model).map_err(|why| EngineError::read(model, why))?;
    let is_named = |extension: &&str| model.extension().is_some_and(|own| own == *extension);
    if file.whole.starts_with(ZIP) || ["pt", "pth"].iter().any(is_named) {
        let model_pt = model.with_extension("pt");
        let remedy = format!("export it: yolo export model={} format=onnx", model_pt.display());
        return Err(EngineError::read(model, format!("is a PyTorch file; {remedy}")));
    }
    Ok(file)
}

/// The first bytes of a ZIP archive, which PyTorch writes.
const ZIP: &[u8] = b"PK\x03\x04";

/// Loads `model` with the engine asked for, on the device asked for. `auto` takes ONNX Runtime where its library is found, else
/// rten: never another one because a model does not load, and never the processor in place of a GPU.
pub fn open(model: &Path, options: EngineOptions) -> Result<OpenedEngine, EngineError> {
    #[cfg(test)]
    if let Some(opened) = crate::ready::searching(model) {
        return Ok(opened);
    }
    // A file that is missing or of another kind is the most common mistake, and engines describe it at length.
    let file = file(model)?;
    let (EngineOptions { device, .. }, threads) = (options, options.cores());
    let (engine, reason) = match (options.engine, device) {
        (EngineChoice::Auto, EngineDevice::Cpu) if onnxruntime::library().is_err() => {
            (EngineChoice::Rten, "auto: no ONNX Runtime library found")
        }
        (EngineChoice::Auto, _) => (EngineChoice::OnnxRuntime, "auto"),
        (engine, _) => (engine, "as asked"),
    };
    let name = engine.word();
    if device != EngineDevice::Cpu && engine != EngineChoice::OnnxRuntime {
        let why = format!("engine {name} runs on the processor only, not on {device}");
        return Err(EngineError(format!("{why}; set engine to ort, or device to cpu")));
    }
    if engine == EngineChoice::Rten {
        let (opened, layout) = self::rten::Rten::load(model, file, threads)?;
        let note = reason.to_owned();
        let engine = SharedEngine::new(opened);
        return Ok(OpenedEngine { engine, name, threads, layout, note, searches: false });
    }
    let library = onnxruntime::library()?;
    let (opened, layout) = onnxruntime::OnnxRuntime::load((model, file), (engine, options), &library)?;
    let bf16 = onnxruntime::uses_bf16(engine);
    let note = if bf16 { format!("{}, bf16", library.place) } else { library.place };
    let (engine, searches) = (SharedEngine::new(opened), device != EngineDevice::Cpu);
    Ok(OpenedEngine { engine, name, threads, layout, note, searches })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_is_written_as_it_is_read() {
        for device in
            [EngineDevice::Cpu, EngineDevice::Cuda(0), EngineDevice::Cuda(3), EngineDevice::TensorRt(1)]
        {
            assert_eq!(device.to_string().parse(), Ok(device));
        }
        assert_eq!(
            ("cuda".parse(), "tensorrt".parse()),
            (Ok(EngineDevice::Cuda(0)), Ok(EngineDevice::TensorRt(0)))
        );
        for bad in ["", "gpu", "cpu:0", "cuda:", "cuda:-1", "cuda:256", "cuda:1:1", "CUDA"] {
            assert!(bad.parse::<EngineDevice>().is_err_and(|why| why.contains("cuda:1")), "{bad}");
        }
    }

    #[test]
    fn no_engine_falls_back_from_a_gpu() {
        let device = EngineDevice::Cuda(0);
        let cudnn_search = CudnnSearch::Heuristic;
        let open =
            |engine| open(Path::new("demo"), EngineOptions { engine, device, cudnn_search, threads: 1 });
        for engine in [EngineChoice::Rten, EngineChoice::OpenVino, EngineChoice::OpenVinoF32] {
            let why = open(engine).err().expect("refused").to_string();
            assert!(why.contains("cuda:0") && why.contains("set engine to ort"), "{why}");
        }
        // There may be a library on this machine, but none with CUDA where the tests run.
        for engine in [EngineChoice::Auto, EngineChoice::OnnxRuntime] {
            let why = open(engine).err().expect("refused").to_string();
            assert!(
                why.contains("no ONNX Runtime library") || why.contains("on cuda:0 is not possible"),
                "{why}"
            );
        }
    }
}
