//! [`Plan`]: the processes that a launch file starts, with every value in place, as text, and as nodes of one process.
//! Nothing is started here; the same file and arguments give the same plan.

mod action;
mod arguments;
mod attributes;
mod circle;
mod resolve;
mod scope;

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

use modulo_runtime::secret::without_secrets;

use crate::LaunchError;
use crate::package::SUITE;

pub use action::{DeclaredArgument, ParameterText};
pub use arguments::declared_arguments;
pub use circle::circle_of;
pub use resolve::resolve;

/// Everything that a launch file starts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// ROS 2 nodes in the order of the file.
    pub nodes: Vec<NodePlan>,
    /// Other programs in the order of the file.
    pub executables: Vec<ExecutablePlan>,
}

/// A ROS 2 node to start.
#[derive(Clone, Debug, PartialEq)]
pub struct NodePlan {
    /// Its package; `modulo` is this suite.
    pub package: String,
    /// Its executable within the package.
    pub executable: String,
    /// Its name; `None` leaves the program's own, always `Some` for this suite.
    pub name: Option<String>,
    /// Its namespace, absolute, `/` for none.
    pub namespace: String,
    /// Its own parameters and parameter files, in order; a later one wins.
    pub parameters: Vec<NodeParameter>,
    /// (from, to) in order; the first that fits is used.
    pub remaps: Vec<(String, String)>,
    /// Arguments before `--ros-args`.
    pub args: Vec<String>,
    /// More arguments after `--ros-args`.
    pub ros_args: Vec<String>,
    /// How it is run.
    pub process: ProcessPlan,
    /// Launch file and line that declare it.
    pub declared_at: (PathBuf, usize),
}

/// An entry of `param` in a launch file: the values that it sets.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NodeParameter {
    /// The values of a parameter file.
    File(PathBuf),
    /// The name and the value of one parameter.
    Value(String, ParameterText),
}

/// A program that is no node.
#[derive(Clone, Debug, PartialEq)]
pub struct ExecutablePlan {
    /// Program and arguments; never empty.
    pub command: Vec<String>,
    /// How it is run.
    pub process: ProcessPlan,
}

/// How a process is run.
#[derive(Clone, Debug, PartialEq)]
pub struct ProcessPlan {
    /// The mark in front of each line of its output.
    pub label: String,
    /// Variables to set in the launcher's environment.
    pub env: BTreeMap<String, String>,
    /// Whether its standard error alone is shown, and not its standard output: ROS 2's `log`.
    pub errors_only: bool,
    /// The pause before it is started again after a crash; `None` for one that stays down.
    pub respawn: Option<Duration>,
    /// Whether the other processes are shut down when it has ended.
    pub ends_all: bool,
    /// From SIGINT to SIGTERM at a shutdown.
    pub sigterm_timeout: Duration,
    /// From SIGTERM to SIGKILL at a shutdown.
    pub sigkill_timeout: Duration,
}

impl Plan {
    /// How every process is run, nodes first.
    pub fn processes(&self) -> impl Iterator<Item = &ProcessPlan> {
        self.nodes.iter().map(|n| &n.process).chain(self.executables.iter().map(|e| &e.process))
    }
}

impl NodePlan {
    /// `/namespace/name`; `None` when the program chooses its name.
    pub fn fully_qualified(&self) -> Option<String> {
        let name = self.name.as_ref()?;
        Some(format!("{}/{name}", self.namespace.trim_end_matches('/')))
    }
}

/// The arguments that tell a node's program who it is:
/// `args --ros-args -r __node:=... -r __ns:=... -p ... --params-file ... -p ... -r ...`.
pub fn ros_arguments(node: &NodePlan) -> Vec<String> {
    let mut all = node.args.clone();
    all.push("--ros-args".to_owned());
    let mut push = |flag: &str, value: String| all.extend([flag.to_owned(), value]);
    if let Some(name) = &node.name {
        push("-r", format!("__node:={name}"));
    }
    push("-r", format!("__ns:={}", node.namespace));
    for parameter in &node.parameters {
        match parameter {
            NodeParameter::File(file) => push("--params-file", file.display().to_string()),
            NodeParameter::Value(name, value) => push("-p", format!("{name}:={value}")),
        }
    }
    node.remaps.iter().for_each(|(from, to)| push("-r", format!("{from}:={to}")));
    all.extend(node.ros_args.iter().cloned());
    all
}

/// Returns the nodes of `plan`, which can run in one process. A setting that is not possible there is refused.
///
/// # Errors
/// [`LaunchError::Other`] for executables, nodes of other packages, and settings that only a process of its own can have.
pub fn compose(plan: &Plan) -> Result<&[NodePlan], LaunchError> {
    if let Some(executable) = plan.executables.first() {
        return Err(refuse(&executable.process.label, "it is an executable, not a node of this suite"));
    }
    for node in &plan.nodes {
        let label = &node.process.label;
        if node.package != SUITE {
            let why = format!("its package is '{}', only nodes of '{SUITE}' can", node.package);
            return Err(refuse(label, &why));
        }
        // Each of these belongs to a whole process: in a shared one it would reach the other nodes as well.
        let own = [
            (!node.args.is_empty(), "args"),
            (!node.ros_args.is_empty(), "ros_args"),
            (!node.process.env.is_empty(), "env"),
        ];
        if let Some((_, setting)) = own.iter().find(|(used, _)| *used) {
            return Err(refuse(label, &format!("it has {setting}, which needs a process of its own")));
        }
    }
    Ok(&plan.nodes)
}

fn refuse(process: &str, why: &str) -> LaunchError {
    LaunchError::Other(format!("{process} cannot run in one process: {why}"))
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shown = |value: &dyn fmt::Display| without_secrets(&value.to_string()).into_owned();
        for node in &self.nodes {
            let name = node.fully_qualified().unwrap_or_else(|| format!("{} (its own name)", node.namespace));
            writeln!(f, "node {name}: {}/{}", node.package, node.executable)?;
            node.parameters.iter().try_for_each(|parameter| match parameter {
                NodeParameter::File(file) => writeln!(f, "  params {}", file.display()),
                NodeParameter::Value(name, value) => writeln!(f, "  {name} = {}", shown(value)),
            })?;
            node.remaps.iter().try_for_each(|(from, to)| writeln!(f, "  {from} -> {to}"))?;
            for (what, arguments) in [("args", &node.args), ("ros_args", &node.ros_args)] {
                if !arguments.is_empty() {
                    writeln!(f, "  {what} {}", shown(&arguments.join(" ")))?;
                }
            }
            node.process.fmt(f)?;
        }
        self.executables.iter().try_for_each(|executable| {
            writeln!(f, "executable {}: {}", executable.process.label, executable.command.join(" "))?;
            executable.process.fmt(f)
        })
    }
}

/// Shows the settings that differ from the defaults.
impl fmt::Display for ProcessPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.env.iter().try_for_each(|(name, value)| writeln!(f, "  env {name}={value}"))?;
        if self.errors_only {
            writeln!(f, "  shows its errors only")?;
        }
        if let Some(delay) = self.respawn {
            writeln!(f, "  started again after a crash, {} s later", delay.as_secs_f64())?;
        }
        if self.ends_all {
            writeln!(f, "  its end is the end of all")?;
        }
        Ok(())
    }
}
