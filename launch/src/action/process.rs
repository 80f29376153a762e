//! Reading `node` and `executable`.

use super::{Kind, Parameter, value};
use crate::attributes::{Attributes, Text};
use crate::error::{LaunchError, Mistakes};
use crate::yaml::ScalarType;

/// The keys of a node beside those of a process.
pub(super) const NODE_KEYS: &[&str] =
    &["pkg", "exec", "namespace", "args", "ros_args", "exec_name", "param", "remap"];

/// The keys of a node and of an executable.
pub(super) const PROCESS_KEYS: &[&str] = &[
    "name",
    "env",
    "output",
    "respawn",
    "respawn_delay",
    "respawn_max_retries",
    "cwd",
    "on_exit",
    "sigterm_timeout",
    "sigkill_timeout",
];

/// How a process is run.
#[derive(Clone, Debug)]
pub(crate) struct ProcessAction {
    pub name: Option<Text>,
    pub env: Vec<(Text, Text)>,
    pub output: Option<Text>,
    pub respawn: Option<Text>,
    pub respawn_delay: Option<Text>,
    pub respawn_max_retries: Option<Text>,
    pub cwd: Option<Text>,
    pub on_exit: Option<Text>,
    pub sigterm_timeout: Option<Text>,
    pub sigkill_timeout: Option<Text>,
}

/// A program to start.
#[derive(Clone, Debug)]
pub(crate) struct ExecutableAction {
    pub command: Text,
    pub process: ProcessAction,
}

/// A ROS 2 node to start.
#[derive(Clone, Debug)]
pub(crate) struct NodeAction {
    pub package: Text,
    pub executable: Text,
    pub namespace: Option<Text>,
    /// The label of its output, when it is not the node's name.
    pub label: Option<Text>,
    pub args: Option<Text>,
    pub ros_args: Option<Text>,
    pub parameters: Vec<Parameter>,
    pub remaps: Vec<(Text, Text)>,
    pub process: ProcessAction,
}

pub(super) fn node(attributes: &Attributes<'_>) -> Result<Kind, Mistakes> {
    Ok(Kind::Node(Box::new(NodeAction {
        package: attributes.required("pkg")?,
        executable: attributes.required("exec")?,
        namespace: attributes.text("namespace")?,
        label: attributes.text("exec_name")?,
        args: command_line(attributes, "args")?,
        ros_args: command_line(attributes, "ros_args")?,
        parameters: value::parameters(attributes)?,
        remaps: attributes.pairs("remap", ["from", "to"])?,
        process: process(attributes)?,
    })))
}

/// ROS 2 gives a node an empty argument for an empty text.
fn command_line(attributes: &Attributes<'_>, key: &str) -> Result<Option<Text>, LaunchError> {
    match attributes.text(key)? {
        Some(text) if text.source.is_empty() => {
            Err(attributes.refuse(text.line, format!("{key}: is empty, leave it out")))
        }
        text => Ok(text),
    }
}

pub(super) fn executable(attributes: &Attributes<'_>) -> Result<Kind, Mistakes> {
    let command = attributes.required("cmd")?;
    Ok(Kind::Executable(Box::new(ExecutableAction { command, process: process(attributes)? })))
}

fn process(attributes: &Attributes<'_>) -> Result<ProcessAction, LaunchError> {
    Ok(ProcessAction {
        name: attributes.text("name")?,
        env: attributes.pairs("env", ["name", "value"])?,
        output: attributes.text("output")?,
        respawn: attributes.text("respawn")?,
        respawn_delay: attributes.literal("respawn_delay", ScalarType::Float)?,
        respawn_max_retries: attributes.literal("respawn_max_retries", ScalarType::Integer)?,
        cwd: attributes.text("cwd")?,
        on_exit: attributes.plain("on_exit")?,
        sigterm_timeout: attributes.literal("sigterm_timeout", ScalarType::Float)?,
        sigkill_timeout: attributes.literal("sigkill_timeout", ScalarType::Float)?,
    })
}
