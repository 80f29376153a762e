//! The list of nodes by the name of their executable: the one place that knows all of them.

use anyhow::Context;
use modulo_camera::{CameraParameters, ModuloCamera};
use modulo_detector::{Detector, DetectorParameters};
use modulo_runtime::driver::CommonParameters;
use modulo_runtime::graph::{self, NameError};
use modulo_runtime::{Descriptor, Node, NodeName, ParameterSet as _, Parameters, Topic};
use modulo_unwrap::{UnwrapNode, UnwrapParameters};

/// One kind of node.
pub struct NodeKind {
    /// Name of the executable, and of the node unless it gets another.
    pub name: &'static str,
    /// A description of one line.
    pub about: &'static str,
    declare: fn() -> Vec<Descriptor>,
    outputs: fn() -> Vec<Topic>,
    make: fn(&Parameters) -> anyhow::Result<Box<dyn Node>>,
}

/// All kinds, in the order in which frames pass them.
pub const KINDS: [NodeKind; 3] = [
    NodeKind {
        name: "modulo_camera",
        about: "a simulated modulo sensor over any source of frames",
        declare: CameraParameters::descriptors,
        outputs: modulo_camera::outputs,
        make: |parameters| Ok(Box::new(ModuloCamera::new(&parameters.into())?)),
    },
    NodeKind {
        name: "unwrap",
        about: "modulo image in, recovered image out",
        declare: UnwrapParameters::descriptors,
        outputs: modulo_unwrap::outputs,
        make: |parameters| Ok(Box::new(UnwrapNode::new(&parameters.into())?)),
    },
    NodeKind {
        name: "detector",
        about: "image in, bounding boxes out (YOLOv10, end to end)",
        declare: DetectorParameters::descriptors,
        outputs: modulo_detector::outputs,
        make: |parameters| Ok(Box::new(Detector::new(&parameters.into())?)),
    },
];

/// The kind called `name`.
pub fn kind(name: &str) -> anyhow::Result<&'static NodeKind> {
    KINDS.iter().find(|kind| kind.name == name).with_context(|| {
        let known: Vec<_> = KINDS.iter().map(|kind| kind.name).collect();
        format!("node '{name}' is unknown, known are {}", known.join(", "))
    })
}

impl NodeKind {
    /// The parameters of a node of this kind and name with their defaults.
    pub fn parameters_of(&self, node_name: &NodeName) -> Result<Parameters, NameError> {
        let overrides = graph::qos_overrides(node_name, &(self.outputs)())?;
        Ok(Parameters::declare([(self.declare)(), CommonParameters::descriptors(), overrides].concat()))
    }

    /// Its parameters with their defaults, without those that depend on the name of the node.
    pub fn parameters(&self) -> Parameters {
        Parameters::declare([(self.declare)(), CommonParameters::descriptors()].concat())
    }

    /// A node with these parameters.
    pub fn make(&self, parameters: &Parameters) -> anyhow::Result<Box<dyn Node>> {
        (self.make)(parameters)
    }
}
