//! Reading `node` and `executable`, with their parameters: name and value or nested ones, or a file.

use modulo_runtime::yaml::{Content, Item, ScalarType};

use super::ActionKind;
use crate::attributes::{Attributes, Text};
use crate::{LaunchError, listed};

/// The keys of a node beside those of a process.
pub(super) const NODE_KEYS: &[&str] = &["pkg", "exec", "namespace", "args", "ros_args", "param", "remap"];

/// The keys of a node and of an executable.
pub(super) const PROCESS_KEYS: &[&str] =
    &["name", "env", "output", "respawn", "respawn_delay", "on_exit", "sigterm_timeout", "sigkill_timeout"];

const PARAMETER_KEYS: [&str; 4] = ["name", "value", "type", "from"];
/// The types that the value of a parameter may have in the file.
const SCALARS: [ScalarType; 4] =
    [ScalarType::Integer, ScalarType::Float, ScalarType::Bool, ScalarType::String];
/// The types of ROS 2's launch files for a parameter that is no list.
const TYPES: [&str; 4] = ["int", "float", "bool", "str"];

#[derive(Clone, Debug)]
pub(crate) struct ProcessAction {
    pub name: Option<Text>,
    pub env: Vec<(Text, Text)>,
    pub output: Option<Text>,
    pub respawn: Option<Text>,
    pub respawn_delay: Option<Text>,
    /// Whether the end of the process is the end of all.
    pub ends_all: bool,
    pub sigterm_timeout: Option<Text>,
    pub sigkill_timeout: Option<Text>,
}

#[derive(Clone, Debug)]
pub(crate) struct ExecutableAction {
    pub command: Text,
    pub process: ProcessAction,
}

#[derive(Clone, Debug)]
pub(crate) struct NodeAction {
    pub package: Text,
    pub executable: Text,
    pub namespace: Option<Text>,
    pub args: Option<Text>,
    pub ros_args: Option<Text>,
    pub parameters: Vec<Parameter>,
    pub remaps: Vec<(Text, Text)>,
    pub process: ProcessAction,
}

#[derive(Clone, Debug)]
pub(crate) enum Parameter {
    /// A file in ROS 2's parameter format.
    File(Text),
    /// One parameter.
    Value { name: Text, value: ParameterValue, kind: Option<&'static str> },
}

#[derive(Clone, Debug)]
pub(crate) enum ParameterValue {
    Scalar(Written),
    List(Vec<Written>),
}

/// A scalar with its type as it is written; the type is `None` where a substitution decides on it.
pub(crate) type Written = (Text, Option<ScalarType>);

pub(super) fn node(attributes: &Attributes<'_>) -> Result<ActionKind, LaunchError> {
    Ok(ActionKind::Node(Box::new(NodeAction {
        package: attributes.required("pkg")?,
        executable: attributes.required("exec")?,
        namespace: attributes.text("namespace")?,
        args: command_line(attributes, "args")?,
        ros_args: command_line(attributes, "ros_args")?,
        parameters: parameters(attributes)?,
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

pub(super) fn executable(attributes: &Attributes<'_>) -> Result<ActionKind, LaunchError> {
    let command = attributes.required("cmd")?;
    Ok(ActionKind::Executable(Box::new(ExecutableAction { command, process: process(attributes)? })))
}

fn process(attributes: &Attributes<'_>) -> Result<ProcessAction, LaunchError> {
    Ok(ProcessAction {
        name: attributes.text("name")?,
        env: attributes.pairs("env", ["name", "value"])?,
        output: attributes.text("output")?,
        respawn: attributes.text("respawn")?,
        respawn_delay: attributes.literal("respawn_delay", ScalarType::Float)?,
        ends_all: ends_all(attributes)?,
        sigterm_timeout: attributes.literal("sigterm_timeout", ScalarType::Float)?,
        sigkill_timeout: attributes.literal("sigkill_timeout", ScalarType::Float)?,
    })
}

fn ends_all(attributes: &Attributes<'_>) -> Result<bool, LaunchError> {
    match attributes.plain("on_exit")? {
        Some((line, text)) if text != "shutdown" => {
            Err(LaunchError::at(attributes.file, line, format!("on_exit = '{text}' must be shutdown")))
        }
        on_exit => Ok(on_exit.is_some()),
    }
}

fn parameters(attributes: &Attributes<'_>) -> Result<Vec<Parameter>, LaunchError> {
    attributes.entries("param", &PARAMETER_KEYS)?.iter().map(parameter).collect()
}

fn parameter(entry: &Attributes<'_>) -> Result<Parameter, LaunchError> {
    if let Some(file) = entry.text("from")? {
        let is_alone = PARAMETER_KEYS[..3].iter().all(|key| entry.item(key).is_none());
        let why = "'from' must be the only key of its entry";
        return if is_alone { Ok(Parameter::File(file)) } else { Err(entry.refuse(file.line, why)) };
    }
    let name = entry.required("name")?;
    let item = entry.item("value").ok_or_else(|| entry.missing("value"))?;
    let kind = kind(entry)?;
    check_types(entry, item, kind)?;
    Ok(Parameter::Value { name, value: read(entry, item)?, kind })
}

fn kind(entry: &Attributes<'_>) -> Result<Option<&'static str>, LaunchError> {
    let Some(text) = entry.text("type")? else { return Ok(None) };
    let given = text.source.as_str();
    let known = TYPES.iter().find(|kind| **kind == given).copied();
    known.map(Some).ok_or_else(|| {
        entry.refuse(text.line, format!("type: unknown '{given}', known are {}", listed(TYPES, "")))
    })
}

/// Checks the types of `item`. ROS 2 converts a string with a substitution to the type that is asked for, and nothing
/// else. The items of a list are of one type beside such strings.
fn check_types(entry: &Attributes<'_>, item: &Item, kind: Option<&str>) -> Result<(), LaunchError> {
    let items = match (&item.content, kind) {
        (Content::List(_), Some(kind)) => {
            return Err(entry.refuse(item.line, format!("value: is a list, must be of type {kind}")));
        }
        (Content::List(items), None) => items.as_slice(),
        _ => std::slice::from_ref(item),
    };
    let type_of = |item: &Item| match &item.content {
        Content::Scalar(text, ScalarType::String) if text.contains("$(") => None,
        Content::Scalar(_, ScalarType::String) => Some("str"),
        Content::Scalar(_, ScalarType::Bool) => Some("bool"),
        Content::Scalar(_, ScalarType::Integer) => Some("int"),
        Content::Scalar(_, ScalarType::Float) => Some("float"),
        _ => None,
    };
    // A string with a substitution has no type yet, so the first item that has one decides for the list.
    let first = items.iter().find_map(type_of);
    for item in items {
        let given = type_of(item);
        let wrong = |must: &str| {
            let why = format!("value: {} must be of type {must}", item.described());
            Err(entry.refuse(item.line, why))
        };
        match (given, kind, first) {
            (Some(given), Some(kind), _) if given != kind => return wrong(kind),
            (Some(given), None, Some(first)) if given != first => {
                return wrong(&format!("{first} as the first in its list"));
            }
            _ => {}
        }
    }
    Ok(())
}

/// The value of a parameter in `item`. An empty list has no type in ROS 2.
fn read(attributes: &Attributes<'_>, item: &Item) -> Result<ParameterValue, LaunchError> {
    let Content::List(items) = &item.content else {
        return Ok(ParameterValue::Scalar(written(attributes, item)?));
    };
    if items.is_empty() {
        let why = "value: an empty list has no type for ROS 2, leave the parameter out";
        return Err(attributes.refuse(item.line, why));
    }
    let items: Result<_, _> = items.iter().map(|item| written(attributes, item)).collect();
    Ok(ParameterValue::List(items?))
}

fn written(attributes: &Attributes<'_>, item: &Item) -> Result<Written, LaunchError> {
    let text = attributes.scalar("value", item, &SCALARS)?;
    let kind = match item.content {
        Content::Scalar(_, kind) if text.template.as_plain().is_some() => Some(kind),
        _ => None,
    };
    Ok((text, kind))
}
