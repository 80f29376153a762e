//! [`DetectorError`]: why there is no detector.

use modulo_runtime::ParameterError;

use crate::engine::EngineError;

/// Why a detector could not be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DetectorError {
    /// A parameter is not possible, alone or with this model.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The model or the engine cannot be used.
    #[error(transparent)]
    Engine(#[from] EngineError),
}
