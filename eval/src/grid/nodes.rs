//! [`Nodes`]: who makes the nodes that a grid drives.

use modulo_bags::source::Source;
use modulo_camera::ModuloCamera;
use modulo_detector::Detector;
use modulo_runtime::{Node, Parameters};
use modulo_unwrap::UnwrapNode;

use super::GridError;

/// Parameters as (name, value).
pub type Pairs = Vec<(&'static str, String)>;

/// Makes nodes; a test puts its own in between.
pub trait Nodes: Sync {
    /// A camera over `source`.
    ///
    /// # Errors
    /// [`GridError`] for a parameter that is not possible.
    fn camera(&self, source: Box<dyn Source>, parameters: &Pairs) -> Result<Box<dyn Node>, GridError>;

    /// An unwrapping node.
    ///
    /// # Errors
    /// [`GridError`] for a parameter that is not possible.
    fn unwrap(&self, parameters: &Pairs) -> Result<Box<dyn Node>, GridError>;

    /// A detector, warm.
    ///
    /// # Errors
    /// [`GridError`] for a parameter that is not possible, or a model that does not run.
    fn detector(&self, parameters: &Pairs) -> Result<Box<dyn Node>, GridError>;
}

/// The suite's own nodes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Suite;

impl Nodes for Suite {
    fn camera(&self, source: Box<dyn Source>, parameters: &Pairs) -> Result<Box<dyn Node>, GridError> {
        let parameters = set(modulo_camera::declare(), parameters)?;
        Ok(Box::new(ModuloCamera::over(source, &parameters)?))
    }

    fn unwrap(&self, parameters: &Pairs) -> Result<Box<dyn Node>, GridError> {
        Ok(Box::new(UnwrapNode::new(&set(modulo_unwrap::declare(), parameters)?)?))
    }

    fn detector(&self, parameters: &Pairs) -> Result<Box<dyn Node>, GridError> {
        Ok(Box::new(Detector::new(&set(modulo_detector::declare(), parameters)?)?))
    }
}

fn set(declared: Vec<modulo_runtime::Descriptor>, pairs: &Pairs) -> Result<Parameters, GridError> {
    let pairs: Vec<_> = pairs.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
    Ok(Parameters::declare(declared).with_text(&pairs)?)
}
