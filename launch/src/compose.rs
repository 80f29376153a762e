//! From a plan to the nodes of one process. Nothing is run here, and what one
//! process cannot do as several would is refused, not left out.

use crate::error::LaunchError;
use crate::plan::{NodePlan, Plan};
use crate::substitution::SUITE;

/// A node of this suite to run beside others in one process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ComposedNode {
    /// Its executable: `modulo_camera`, `unwrap` or `detector`.
    pub kind: String,
    /// Its name.
    pub name: String,
    /// Its namespace, `/` for none.
    pub namespace: String,
    /// (name, value as text) in order; a later one of the same name wins.
    pub parameters: Vec<(String, String)>,
    /// (from, to) in order; the first that fits is used.
    pub remaps: Vec<(String, String)>,
}

/// The nodes of `plan`.
///
/// # Errors
/// [`LaunchError::NotComposable`] for executables, nodes of other packages, and
/// settings that only a process of its own can have.
pub fn compose(plan: &Plan) -> Result<Vec<ComposedNode>, LaunchError> {
    if let Some(executable) = plan.executables.first() {
        return Err(refuse(&executable.process.label, "it is an executable, not a node of this suite"));
    }
    plan.nodes.iter().map(composed).collect()
}

fn composed(node: &NodePlan) -> Result<ComposedNode, LaunchError> {
    let label = &node.process.label;
    if node.package != SUITE {
        let why = format!("its package is '{}', only nodes of '{SUITE}' can", node.package);
        return Err(refuse(label, &why));
    }
    let own = [
        (!node.args.is_empty(), "args"),
        (!node.ros_args.is_empty(), "ros_args"),
        (!node.parameter_files.is_empty(), "param from a file"),
        (!node.process.env.is_empty(), "env"),
        (node.process.cwd.is_some(), "cwd"),
        (!node.process.start_after.is_zero(), "a timer"),
    ];
    if let Some((_, setting)) = own.iter().find(|(used, _)| *used) {
        return Err(refuse(label, &format!("it has {setting}, which needs a process of its own")));
    }
    Ok(ComposedNode {
        kind: node.executable.clone(),
        name: node.name.clone().unwrap_or_else(|| node.executable.clone()),
        namespace: node.namespace.clone(),
        parameters: node
            .shared_parameters
            .iter()
            .chain(&node.parameters)
            .map(|(name, value)| (name.clone(), value.text.clone()))
            .collect(),
        remaps: node.remaps.clone(),
    })
}

fn refuse(process: &str, why: &str) -> LaunchError {
    LaunchError::NotComposable { process: process.to_owned(), why: why.to_owned() }
}
