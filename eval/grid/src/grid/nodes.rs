//! [`Nodes`]: makes the nodes that a grid runs.

use modulo_bags::source::Source;
use modulo_camera::{CameraParameters, ModuloCamera};
use modulo_detector::{Detector, DetectorParameters};
use modulo_runtime::Node;
use modulo_unwrap::{UnwrapNode, UnwrapParameters};

use super::GridError;

/// Makes nodes. A test can replace some of them.
pub trait Nodes: Sync {
    /// Makes a camera that reads `source`.
    ///
    /// # Errors
    /// [`GridError`] for an impossible parameter.
    fn camera(&self, source: Box<dyn Source>, with: &CameraParameters) -> Result<Box<dyn Node>, GridError> {
        Ok(Box::new(ModuloCamera::over(source, with)?))
    }

    /// Makes an unwrapping node.
    ///
    /// # Errors
    /// [`GridError`] for an impossible parameter.
    fn unwrap(&self, with: &UnwrapParameters) -> Result<Box<dyn Node>, GridError> {
        Ok(Box::new(UnwrapNode::new(with)?))
    }

    /// Makes a detector and warms it up.
    ///
    /// # Errors
    /// [`GridError`] for an impossible parameter or a model that does not run.
    fn detector(&self, with: &DetectorParameters) -> Result<Box<dyn Node>, GridError> {
        Ok(Box::new(Detector::new(with)?))
    }
}

/// Makes the nodes of the suite.
#[derive(Clone, Copy, Debug, Default)]
pub struct Suite;

impl Nodes for Suite {}
