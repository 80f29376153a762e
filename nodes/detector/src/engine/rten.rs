//! rten, pure Rust: the only file that names that crate.

use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::Arc;

use ndarray::{Array2, ArrayView4};
use rten::{DataType, Dimension, Model, NodeId, RunOptions, ThreadPool, ValueType, ValueView};

use super::weights::ModelFile;
use super::{Engine, EngineError};
use crate::head::FORMS;
use crate::model::{FLOAT32, ModelLayout, TensorSpec};

/// The word for this engine.
pub const NAME: &str = "rten";

pub struct Rten {
    model: Model,
    input: NodeId,
    output: NodeId,
    options: RunOptions,
}

impl Rten {
    /// Loads the ONNX model that was read from `path`.
    pub fn load(
        path: &Path,
        file: ModelFile,
        threads: NonZeroUsize,
    ) -> Result<(Self, ModelLayout), EngineError> {
        let failed = |why: String| EngineError::load(path, NAME, why);
        let model = Model::load(file.whole).map_err(|error| failed(error.to_string()))?;
        let [inputs, outputs] = [model.input_ids(), model.output_ids()]
            .map(|ids| ids.iter().map(|&id| port(&model, id)).collect::<Vec<_>>());
        let property = |key: &str| model.metadata().get(key).map(str::to_owned);
        let layout = ModelLayout::of(path, (&inputs, &outputs), &property)?;
        let input = model.node_id(&layout.input).map_err(|error| failed(error.to_string()))?;
        let output = model.node_id(&layout.output).map_err(|error| failed(error.to_string()))?;
        let pool = Arc::new(ThreadPool::with_num_threads(threads.get()));
        let options = RunOptions::default().with_thread_pool(Some(pool));
        Ok((Self { model, input, output, options }, layout))
    }
}

fn port(model: &Model, id: NodeId) -> TensorSpec {
    let info = model.node_info(id);
    let side = |dimension: Dimension| match dimension {
        Dimension::Fixed(side) => Some(side),
        Dimension::Symbolic(_) => None,
    };
    TensorSpec {
        name: info.as_ref().and_then(|info| info.name()).unwrap_or_default().to_owned(),
        element: match info.as_ref().and_then(|info| info.dtype()) {
            Some(ValueType::Tensor(DataType::Float)) => FLOAT32.to_owned(),
            Some(other) => format!("{other:?}").to_lowercase(),
            None => "no type".to_owned(),
        },
        shape: info.and_then(|info| info.shape()).map(|shape| shape.into_iter().map(side).collect()),
    }
}

impl Engine for Rten {
    fn run(&mut self, input: ArrayView4<'_, f32>) -> Result<Array2<f32>, EngineError> {
        let failed = |why: String| EngineError::run(NAME, input, why);
        let pixels = input.to_slice().ok_or_else(|| failed("input is not contiguous".to_owned()))?;
        let tensor =
            ValueView::from_shape(input.shape(), pixels).map_err(|error| failed(error.to_string()))?;
        let [output] = self
            .model
            .run_n(vec![(self.input, tensor.into())], [self.output], Some(self.options.clone()))
            .map_err(|error| failed(error.to_string()))?;
        let (shape, values) = output
            .into_shape_vec::<f32, 3>()
            .map_err(|error| failed(format!("output: {error}, needed is {FORMS}")))?;
        let [1, rows, columns] = shape else {
            return Err(failed(format!("output is {shape:?}, needed is {FORMS}")));
        };
        Array2::from_shape_vec((rows, columns), values).map_err(|error| failed(error.to_string()))
    }
}
