//! ONNX Runtime through `ort`: the only file that names that crate.
//!
//! The library is loaded at run time, once a process, and never downloaded.

use std::fs;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use half::f16;
use half::slice::HalfFloatSliceExt as _;
use modulo_runtime::embedded;
use ndarray::{Array2, ArrayD, ArrayView4};
use ort::environment::Environment;
use ort::ep::cuda::ConvAlgorithmSearch;
use ort::ep::{self, ArbitrarilyConfigurableExecutionProvider as _, ExecutionProvider};
use ort::session::builder::{GraphOptimizationLevel, SessionBuilder};
use ort::session::{Session, SessionInputValue};
use ort::value::{Outlet, TensorElementType, TensorRef, ValueType};

use super::weights::ModelFile;
use super::{CudnnSearch, Engine, EngineChoice, EngineDevice, EngineError, EngineOptions, nvidia};
use crate::head::FORMS;
use crate::model::{self, FLOAT16, FLOAT32, ModelLayout, TensorSpec};

/// The word for this engine.
pub const NAME: &str = "ort";
/// The word for this engine with OpenVINO's kernels.
pub const OPENVINO: &str = "openvino";
/// The word for OpenVINO's kernels with 32 bits.
pub const OPENVINO_F32: &str = "openvino_f32";

#[derive(Clone)]
pub struct Library {
    environment: Environment,
    /// Path of the library.
    pub place: String,
}

/// `ort` allows one environment a process, and drops it with its last owner; this owner lives as long as the process.
static LOADED: Mutex<Option<Library>> = Mutex::new(None);

/// Returns the library that is loaded already, or the first one found.
pub fn library() -> Result<Library, EngineError> {
    let mut loaded = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(library) = loaded.as_ref() {
        return Ok(library.clone());
    }
    let mut looked = Vec::new();
    for place in places_here() {
        match load(&place) {
            Ok(environment) => {
                let library = Library { environment, place: place.display().to_string() };
                return Ok(loaded.insert(library).clone());
            }
            Err(why) => looked.push(format!("{} ({why})", place.display())),
        }
    }
    let remedy = "fetch one with modulo model runtime, set ORT_DYLIB_PATH to a libonnxruntime.so, or set engine to rten";
    let looked = looked.join(", ");
    Err(EngineError(format!("engine 'ort': no ONNX Runtime library found; looked at {looked}; {remedy}")))
}

fn load(place: &Path) -> Result<Environment, String> {
    // The loader's own message repeats the path; a plain one is enough.
    if place.components().count() > 1 && !place.exists() {
        return Err("not there".to_owned());
    }
    let builder = ort::init_from(place).map_err(|error| match error {
        ort::LoadDynamicError::Dlopen { .. } => "not loadable".to_owned(),
        other => super::one_line(other),
    })?;
    builder.with_name("modulo").with_telemetry(false).build().map_err(super::one_line)
}

pub struct OnnxRuntime {
    session: Session,
    engine: &'static str,
    output: String,
    /// The input with 16 bits, where the model wants it so.
    halves: Option<Vec<f16>>,
}

impl OnnxRuntime {
    /// Loads the model that was read from a file with all graph optimisations for `engine` as `options` say.
    /// It fails where `library` has no provider for them or the machine no such device.
    pub fn load(
        (model, file): (&Path, ModelFile),
        (engine, options): (EngineChoice, EngineOptions),
        library: &Library,
    ) -> Result<(Self, ModelLayout), EngineError> {
        let failed = |why: ort::Error| EngineError::load(model, engine.word(), why);
        // Level `All` counts: 61 ms against 100 ms at 640 x 640 without it.
        let builder = Session::builder(&library.environment)
            .and_then(|builder| Ok(builder.with_optimization_level(GraphOptimizationLevel::All)?))
            .and_then(|builder| Ok(builder.with_intra_threads(options.cores().get())?))
            // Threads that wait for the next frame in a loop take the processor from the other nodes, and save no time.
            .and_then(|builder| Ok(builder.with_intra_op_spinning(false)?))
            // A pattern of the memory, made for each size of the input, saves no time, but takes 28 MB at 1248 x 384.
            .and_then(|builder| Ok(builder.with_memory_pattern(false)?))
            .map_err(failed)?;
        let mut builder = with_provider(builder, (engine, options), (library, &file))?;
        let session = match file {
            // Mapped into the memory rather than copied.
            ModelFile { parts, .. } if parts.len() == 1 && model::embedded(model).is_none() => {
                builder.commit_from_file(model)
            }
            ModelFile { whole, .. } => builder.commit_from_memory(&whole),
        };
        let session = session.map_err(failed)?;
        let [inputs, outputs] =
            [session.inputs(), session.outputs()].map(|outlets| outlets.iter().map(port).collect::<Vec<_>>());
        let property = |key: &str| session.metadata().ok()?.custom(key);
        let layout = ModelLayout::of(model, (&inputs, &outputs), &property)?;
        let halves = inputs.iter().any(|input| input.element == FLOAT16).then(Vec::new);
        Ok((Self { session, engine: engine.word(), output: layout.output.clone(), halves }, layout))
    }
}

/// Registers the provider of `engine` on the device, which computes every part of a model that it knows. ONNX Runtime has kernels of its
/// own for the processor.
fn with_provider(
    mut builder: SessionBuilder,
    (engine, options): (EngineChoice, EngineOptions),
    (library, file): (&Library, &ModelFile),
) -> Result<SessionBuilder, EngineError> {
    let device = options.device;
    if device != EngineDevice::Cpu {
        preload(&library.place);
    }
    let registered = match (engine, device) {
        (EngineChoice::OpenVino | EngineChoice::OpenVinoF32, _) => {
            let precision = if uses_bf16(engine) { "bf16" } else { "f32" };
            let config = format!(r#"{{"CPU": {{"INFERENCE_PRECISION_HINT": "{precision}"}}}}"#);
            let openvino = ep::OpenVINO::default()
                .with_device_type("CPU")
                .with_num_threads(options.cores().get())
                .with_arbitrary_config("load_config", config);
            register(&openvino, &mut builder)
        }
        (_, EngineDevice::Cpu) => return Ok(builder),
        (_, EngineDevice::Cuda(number)) => {
            // Trying out all algorithms takes 1.7 to 3.4 s at each size of the input, the rules 0.2 s, for 4.0 instead of 2.9 ms a frame.
            let cuda = ep::CUDA::default().with_conv_algorithm_search(match options.cudnn_search {
                CudnnSearch::Heuristic => ConvAlgorithmSearch::Heuristic,
                CudnnSearch::Exhaustive => ConvAlgorithmSearch::Exhaustive,
            });
            register(&cuda.with_device_id(number.into()), &mut builder)
        }
        (_, EngineDevice::TensorRt(number)) => register(&tensorrt(number.into(), file), &mut builder),
    };
    let (engine, library) = (engine.word(), &library.place);
    let failed = |why: String| {
        let what = format!("engine {engine} on {device} is not possible with the library {library}");
        let (why, remedy) = (nvidia::missing(&why), nvidia::remedy(&why));
        EngineError(format!("{what}: {why}; {remedy}, or set engine to ort and device to cpu"))
    };
    registered.map_err(failed).map(|()| builder)
}

/// Loads the libraries of a GPU that were found for the ONNX Runtime at `place`. One that cannot be loaded is left to the provider, which names
/// what it lacks.
fn preload(place: &str) {
    for file in nvidia::libraries(Path::new(place)) {
        if let Err(why) = ort::util::preload_dylib(&file) {
            tracing::warn!("{} cannot be loaded: {why}", file.display());
        }
    }
}

/// TensorRT with 16 bits, whose engines are kept: making one takes minutes. TensorRT itself makes another one for another GPU, size of the
/// input or version of itself, but not for other weights.
fn tensorrt(device: i32, ModelFile { whole, .. }: &ModelFile) -> ep::TensorRT {
    let provider = ep::TensorRT::default().with_device_id(device).with_fp16(true);
    let mut hash = DefaultHasher::new();
    whole.hash(&mut hash);
    let folder = embedded::cache().and_then(|cache| {
        let folder = cache.join(format!("tensorrt-{:016x}", hash.finish()));
        fs::create_dir_all(&folder).map_err(|why| format!("{}: {why}", folder.display()))?;
        Ok(folder)
    });
    match folder {
        Ok(folder) => {
            let folder = folder.display();
            tracing::info!("TensorRT makes an engine of a new model for minutes, and keeps it in {folder}");
            let provider = provider.with_engine_cache(true).with_engine_cache_path(&folder);
            provider.with_timing_cache(true).with_timing_cache_path(folder)
        }
        Err(why) => {
            tracing::warn!("the engine that TensorRT makes of the model cannot be kept: {why}");
            provider
        }
    }
}

/// Registers a provider, which is never replaced by another one in silence.
fn register<P: ExecutionProvider>(provider: &P, builder: &mut SessionBuilder) -> Result<(), String> {
    if !P::is_available().map_err(super::one_line)? {
        return Err(format!("it was built without {}", P::NAME));
    }
    provider.register(builder).map_err(super::one_line)
}

/// Returns whether `engine` computes with 16 bits (bf16): OpenVINO does where the processor multiplies such numbers.
pub fn uses_bf16(engine: EngineChoice) -> bool {
    #[cfg(target_arch = "x86_64")]
    let multiplies = std::arch::is_x86_feature_detected!("avx512bf16");
    #[cfg(not(target_arch = "x86_64"))]
    let multiplies = false;
    engine == EngineChoice::OpenVino && multiplies
}

fn port(outlet: &Outlet) -> TensorSpec {
    let name = outlet.name().to_owned();
    match outlet.dtype() {
        ValueType::Tensor { ty, shape, .. } => TensorSpec {
            name,
            element: match ty {
                TensorElementType::Float32 => FLOAT32.to_owned(),
                TensorElementType::Float16 => FLOAT16.to_owned(),
                other => other.to_string(),
            },
            shape: Some(shape.iter().map(|&side| usize::try_from(side).ok()).collect()),
        },
        _ => TensorSpec { name, element: "no tensor".to_owned(), shape: None },
    }
}

impl OnnxRuntime {
    /// Runs the session on `input`, and reads its output.
    fn output_of(&mut self, input: ArrayView4<'_, f32>) -> ort::Result<ArrayD<f32>> {
        let tensor: SessionInputValue<'_> = match &mut self.halves {
            None => TensorRef::from_array_view(input)?.into(),
            Some(halves) => {
                let pixels = input.to_slice().expect("the input of an engine is contiguous");
                halves.resize(pixels.len(), f16::ZERO);
                halves.convert_from_f32_slice(pixels);
                TensorRef::from_array_view((input.shape(), halves.as_slice()))?.into()
            }
        };
        let outputs = self.session.run(ort::inputs![tensor])?;
        // The layout names an output of this session.
        let output = &outputs[self.output.as_str()];
        if matches!(output.dtype(), ValueType::Tensor { ty: TensorElementType::Float16, .. }) {
            return Ok(output.try_extract_array::<f16>()?.mapv(f16::to_f32));
        }
        Ok(output.try_extract_array::<f32>()?.into_owned())
    }
}

impl Engine for OnnxRuntime {
    fn run(&mut self, input: ArrayView4<'_, f32>) -> Result<Array2<f32>, EngineError> {
        let engine = self.engine;
        let failed = |why: String| EngineError::run(engine, input, why);
        let output = self.output_of(input).map_err(|error| failed(error.to_string()))?;
        match *output.shape() {
            [1, rows, columns] => {
                Ok(output.into_shape_with_order((rows, columns)).expect("the first side is 1"))
            }
            ref shape => Err(failed(format!("output is {shape:?}, needed is {FORMS}"))),
        }
    }
}

/// Returns the places where ONNX Runtime is looked for, in order; one without a folder is left to the system's loader.
pub fn places_here() -> Vec<PathBuf> {
    let variable = std::env::var_os("ORT_DYLIB_PATH").map(PathBuf::from);
    places(variable, std::env::current_exe().ok().as_deref())
}

/// Returns the places in the order in which they are tried: `$ORT_DYLIB_PATH`, beside the program, the install's
/// library folder, the system's loader.
fn places(variable: Option<PathBuf>, program: Option<&Path>) -> Vec<PathBuf> {
    let name = format!("{}onnxruntime{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let folder = program.and_then(Path::parent);
    let beside = folder.map(|folder| folder.join(&name));
    let installed = folder.map(|folder| folder.join("../lib/modulo").join(&name));
    variable
        .filter(|path| !path.as_os_str().is_empty())
        .into_iter()
        .chain(beside)
        .chain(installed)
        .chain([PathBuf::from(&name)])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_variable_comes_first_and_the_loader_last() {
        let found = places(Some("/opt/my.so".into()), Some(Path::new("/usr/bin/modulo")));
        assert_eq!(found.first().map(PathBuf::as_path), Some(Path::new("/opt/my.so")));
        assert!(found.iter().any(|place| place.starts_with("/usr/bin/../lib/modulo")));
        assert_eq!(found.last().and_then(|place| place.parent()), Some(Path::new("")));
        assert_eq!(places(Some("".into()), None).len(), 1);
    }
}
