//! [`DetectorError`]: a detector could not be made.

use modulo_runtime::ParameterError;

use crate::engine::EngineError;

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
