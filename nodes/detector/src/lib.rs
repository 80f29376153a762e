//! The detector node: the detection models that ultralytics exports, over ONNX Runtime or rten.
//!
//! One image in, one array of boxes out, with the header of that image. Data flows one way: `pre` (pixels to tensor) ->
//! `engine` (tensor to output) -> `post` (output to detections) -> `draw` (only while the annotated image has
//! a reader). `head` tells the form of an output, `candidates` reads it, and `plausible` looks at that of the
//! first run.
//!
//! No transport, no thread of its own and no clock in it.

mod candidates;
mod classes;
mod code_range;
mod draw;
mod engine;
mod export;
mod head;
mod input_size;
mod loaded;
mod measure;
mod model;
mod names;
mod node;
mod parameter;
mod plausible;
mod post;
mod pre;
#[cfg(test)]
#[path = "tests/ready.rs"]
mod ready;
mod sessions;
mod trust;

use modulo_runtime::ParameterError;

pub use classes::parse_class_map;
pub use draw::drawn;
pub use engine::{
    CudnnSearch, EngineChoice, EngineDevice, EngineError, EngineOptions, gpu_libraries, gpus, model_parts,
    onnxruntime_library, onnxruntime_places,
};
pub use export::ClassNumbers;
pub use measure::{ModelInfo, Speed, describe};
pub use model::{DEMO, DEMO_LIMIT, embedded};
pub use node::{Detector, TRUSTED, outputs, topics};
pub use parameter::DetectorParameters;
pub use sessions::Sessions;

/// The class map that the suite ships: COCO's names to KITTI's.
pub const COCO_TO_KITTI: &str = include_str!("../class_maps/coco_to_kitti.yaml");

/// Error: a detector could not be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DetectorError {
    /// A parameter is not possible in general, or not with this model.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The model or the engine cannot be used.
    #[error(transparent)]
    Engine(#[from] EngineError),
}
