//! ONNX Runtime through `ort`: the only file that names that crate.
//!
//! The library is loaded at run time, once a process, and never downloaded.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use ndarray::{Array2, ArrayView4, Ix3};
use ort::environment::Environment;
use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::{Outlet, TensorElementType, TensorRef, ValueType};

use super::{Engine, EngineError, Signature};
use crate::model::{ElementType, ModelLayout, TensorSpec, embedded};

/// The word for this engine.
pub const NAME: &str = "ort";

/// A library that is loaded.
#[derive(Clone)]
pub struct Library {
    environment: Environment,
    /// Path of the library.
    pub place: String,
}

/// `ort` allows one environment a process, and drops it with its last owner; this owner lives as long as the process.
static LOADED: Mutex<Option<Library>> = Mutex::new(None);

/// Returns the library that is loaded already, or the first one found.
///
/// # Errors
/// [`EngineError::NoLibrary`] with all places and the fault of each.
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
    Err(EngineError::NoLibrary(looked.join(", ")))
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

/// A model in ONNX Runtime.
pub struct OnnxRuntime {
    session: Session,
    output: String,
}

impl OnnxRuntime {
    /// Loads `model` with all graph optimisations.
    ///
    /// # Errors
    /// [`EngineError::Load`] or [`EngineError::Shape`].
    pub fn load(
        model: &Path,
        threads: NonZeroUsize,
        library: &Library,
    ) -> Result<(Self, ModelLayout), EngineError> {
        let session = session(model, threads, &library.environment)
            .map_err(|error| EngineError::load(model, NAME, error))?;
        let layout = ModelLayout::of(model, &signature(&session))?;
        Ok((Self { session, output: layout.output.clone() }, layout))
    }
}

fn session(model: &Path, threads: NonZeroUsize, environment: &Environment) -> ort::Result<Session> {
    // Level `All` counts: 61 ms against 100 ms at 640 x 640 without it.
    let mut builder = Session::builder(environment)?
        .with_optimization_level(GraphOptimizationLevel::All)?
        .with_intra_threads(threads.get())?;
    match embedded(model) {
        Some(bytes) => builder.commit_from_memory(bytes),
        None => builder.commit_from_file(model),
    }
}

fn signature(session: &Session) -> Signature {
    Signature {
        inputs: session.inputs().iter().map(port).collect(),
        outputs: session.outputs().iter().map(port).collect(),
        names: session.metadata().ok().and_then(|metadata| metadata.custom("names")),
    }
}

fn port(outlet: &Outlet) -> TensorSpec {
    let name = outlet.name().to_owned();
    match outlet.dtype() {
        ValueType::Tensor { ty, shape, .. } => TensorSpec {
            name,
            element: match ty {
                TensorElementType::Float32 => ElementType::F32,
                other => ElementType::Other(other.to_string()),
            },
            shape: Some(shape.iter().map(|&side| usize::try_from(side).ok()).collect()),
        },
        _ => TensorSpec { name, element: ElementType::Other("no tensor".to_owned()), shape: None },
    }
}

impl Engine for OnnxRuntime {
    fn run(&mut self, input: ArrayView4<'_, f32>) -> Result<Array2<f32>, EngineError> {
        let failed = |why: String| EngineError::run(NAME, input, why);
        let tensor = TensorRef::from_array_view(input).map_err(|error| failed(error.to_string()))?;
        let outputs = self.session.run(ort::inputs![tensor]).map_err(|error| failed(error.to_string()))?;
        let rows = outputs
            .get(&self.output)
            .ok_or_else(|| failed(format!("no output '{}'", self.output)))?
            .try_extract_array::<f32>()
            .map_err(|error| failed(error.to_string()))?;
        let shape = rows.shape().to_vec();
        match rows.into_dimensionality::<Ix3>() {
            Ok(rows) if rows.dim().0 == 1 && rows.dim().2 == 6 => {
                Ok(rows.index_axis(ndarray::Axis(0), 0).to_owned())
            }
            _ => Err(failed(format!("output is {shape:?}, needed is [1, N, 6]"))),
        }
    }
}

/// Returns the places that this process tries, in order.
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
