//! [`Nodes`]: who makes the nodes that a grid drives.

use modulo_bags::source::Source;
use modulo_camera::{CameraParameters, ModuloCamera};
use modulo_detector::{Detector, DetectorParameters};
use modulo_runtime::Node;
use modulo_unwrap::{UnwrapNode, UnwrapParameters};

use super::GridError;

/// Makes nodes; a test puts its own in between.
pub trait Nodes: Sync {
    /// A camera over `source`.
    ///
    /// # Errors
    /// [`GridError`] for a parameter that is not possible.
    fn camera(&self, source: Box<dyn Source>, with: &CameraParameters) -> Result<Box<dyn Node>, GridError> {
        Ok(Box::new(ModuloCamera::over(source, with)?))
    }

    /// An unwrapping node.
    ///
    /// # Errors
    /// [`GridError`] for a parameter that is not possible.
    fn unwrap(&self, with: &UnwrapParameters) -> Result<Box<dyn Node>, GridError> {
        Ok(Box::new(UnwrapNode::new(with)?))
    }

    /// A detector, warm.
    ///
    /// # Errors
    /// [`GridError`] for a parameter that is not possible, or a model that does not run.
    fn detector(&self, with: &DetectorParameters) -> Result<Box<dyn Node>, GridError> {
        Ok(Box::new(Detector::new(with)?))
    }
}

/// The suite's own nodes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Suite;

impl Nodes for Suite {}
