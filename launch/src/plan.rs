//! [`Plan`]: what a launch file comes to, with every value in place. Nothing is
//! started here; the same file and arguments give the same plan.

mod arguments;
mod command_line;
mod parameter;
mod print;
mod process;
mod resolve;
mod scope;
mod value;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use serde::Serialize;

pub use arguments::{DeclaredArgument, declared_arguments};
pub use parameter::ParameterText;
pub use resolve::{check, resolve};
pub(crate) use scope::environment;

/// Everything that a launch file starts.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Plan {
    /// The value that every declared argument has in the end.
    pub arguments: BTreeMap<String, String>,
    /// What `log` actions say, in order.
    pub messages: Vec<String>,
    /// ROS 2 nodes in the order of the file.
    pub nodes: Vec<NodePlan>,
    /// Other programs in the order of the file.
    pub executables: Vec<ExecutablePlan>,
}

/// A ROS 2 node to start.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NodePlan {
    /// Its package; `modulo` is this suite.
    pub package: String,
    /// Its executable within the package.
    pub executable: String,
    /// Its name; `None` leaves the program's own, always `Some` for this suite.
    pub name: Option<String>,
    /// Its namespace, absolute, `/` for none.
    pub namespace: String,
    /// (name, value) from `set_parameter`, for all nodes that follow it; a
    /// later one of the same name wins, and all that follows here wins over them.
    pub shared_parameters: Vec<(String, ParameterText)>,
    /// Parameter files, read before `parameters`.
    pub parameter_files: Vec<PathBuf>,
    /// (name, value) in order; a later one of the same name wins.
    pub parameters: Vec<(String, ParameterText)>,
    /// (from, to) in order; the first that fits is used.
    pub remaps: Vec<(String, String)>,
    /// Arguments before `--ros-args`.
    pub args: Vec<String>,
    /// More arguments after `--ros-args`.
    pub ros_args: Vec<String>,
    /// How it is run.
    pub process: ProcessPlan,
    /// Launch file and line that declare it.
    #[serde(skip)]
    pub declared_at: (PathBuf, usize),
}

/// A program that is no node.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ExecutablePlan {
    /// Program and arguments; never empty.
    pub command: Vec<String>,
    /// How it is run.
    pub process: ProcessPlan,
}

/// How a process is run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProcessPlan {
    /// What its output lines are marked with.
    pub label: String,
    /// Variables to set, and those to remove (`None`), in the launcher's environment.
    pub env: BTreeMap<String, Option<String>>,
    /// Its working folder; the launcher's when `None`.
    pub cwd: Option<PathBuf>,
    /// Which of its output is shown.
    pub output: Output,
    /// Whether it is started again after a crash.
    pub respawn: Respawn,
    /// What its end means for the others.
    pub on_exit: OnExit,
    /// From SIGINT to SIGTERM at a shutdown.
    pub sigterm_timeout: Duration,
    /// From SIGTERM to SIGKILL at a shutdown.
    pub sigkill_timeout: Duration,
    /// Started this long after the launch.
    pub start_after: Duration,
}

/// Which output of a process is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Output {
    /// Both streams.
    #[default]
    Screen,
    /// Standard error only: ROS 2's `log`.
    Log,
}

/// Whether a process that crashed is started again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Respawn {
    /// It stays down.
    #[default]
    Never,
    /// It is started again.
    After {
        /// Pause before each start.
        delay: Duration,
        /// Starts after the first one; `None` for any number.
        max_retries: Option<u32>,
    },
}

/// What the end of a process means for the others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum OnExit {
    /// They go on.
    #[default]
    Continue,
    /// They are shut down.
    Shutdown,
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
    let set = |(name, value): &(String, ParameterText)| format!("{name}:={}", value.as_yaml());
    node.shared_parameters.iter().for_each(|parameter| push("-p", set(parameter)));
    node.parameter_files.iter().for_each(|file| push("--params-file", file.display().to_string()));
    node.parameters.iter().for_each(|parameter| push("-p", set(parameter)));
    node.remaps.iter().for_each(|(from, to)| push("-r", format!("{from}:={to}")));
    all.extend(node.ros_args.iter().cloned());
    all
}
