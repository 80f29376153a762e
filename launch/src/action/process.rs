//! Reading `node` and `executable`, with their parameters: name and value or nested ones, or a file.

use modulo_runtime::yaml::{Content, Item, ScalarType};

use super::ActionKind;
use crate::attributes::{Attributes, Text};
use crate::substitution::{Part, Template};
use crate::{LaunchError, Mistakes, listed};

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

const PARAMETER_KEYS: [&str; 5] = ["name", "value", "type", "param", "from"];
/// The types that the value of a parameter may have in the file.
const SCALARS: [ScalarType; 4] =
    [ScalarType::Integer, ScalarType::Float, ScalarType::Bool, ScalarType::String];
/// The parameter types of ROS 2's launch files.
const TYPES: [&str; 8] =
    ["int", "float", "bool", "str", "list_of_int", "list_of_float", "list_of_bool", "list_of_str"];

#[derive(Clone, Debug)]
pub(crate) struct ProcessAction {
    pub name: Option<Text>,
    pub env: Vec<(Text, Text)>,
    pub output: Option<Text>,
    pub respawn: Option<Text>,
    pub respawn_delay: Option<Text>,
    pub respawn_max_retries: Option<Text>,
    pub cwd: Option<Text>,
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
    /// The label of its output, when it is not the node's name.
    pub label: Option<Text>,
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
    /// One parameter; nested names are joined with dots.
    Value { name: Text, value: ParameterValue, kind: Option<&'static str> },
}

#[derive(Clone, Debug)]
pub(crate) enum ParameterValue {
    Scalar(Written),
    List(Vec<Written>),
}

/// A scalar with its type as it is written; the type is `None` where a substitution decides on it.
pub(crate) type Written = (Text, Option<ScalarType>);

pub(super) fn node(attributes: &Attributes<'_>) -> Result<ActionKind, Mistakes> {
    Ok(ActionKind::Node(Box::new(NodeAction {
        package: attributes.required("pkg")?,
        executable: attributes.required("exec")?,
        namespace: attributes.text("namespace")?,
        label: attributes.text("exec_name")?,
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

pub(super) fn executable(attributes: &Attributes<'_>) -> Result<ActionKind, Mistakes> {
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
        respawn_max_retries: attributes.literal("respawn_max_retries", ScalarType::Integer)?,
        cwd: attributes.text("cwd")?,
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
    let mut all = Vec::new();
    collect(attributes, None, &mut all)?;
    Ok(all)
}

fn collect(
    attributes: &Attributes<'_>,
    outer: Option<&Text>,
    all: &mut Vec<Parameter>,
) -> Result<(), LaunchError> {
    for entry in attributes.entries("param", &PARAMETER_KEYS)? {
        if let Some(file) = entry.text("from")? {
            let alone = outer.is_none() && PARAMETER_KEYS[..4].iter().all(|key| entry.item(key).is_none());
            if !alone {
                return Err(entry.refuse(file.line, "'from' must be the only key of its entry"));
            }
            all.push(Parameter::File(file));
            continue;
        }
        // A nested parameter has the name that it has in a parameter file of ROS 2: `filter.size`.
        let name = joined(outer, entry.required("name")?);
        match (entry.item("value"), entry.item("param")) {
            (Some(item), None) => {
                let kind = kind(&entry)?;
                check_types(&entry, item, kind)?;
                all.push(Parameter::Value { name, value: read(&entry, item)?, kind });
            }
            (None, Some(_)) => collect(&entry, Some(&name), all)?,
            _ => return Err(entry.refuse(entry.line, "one of 'value' and 'param' is needed")),
        }
    }
    Ok(())
}

fn joined(outer: Option<&Text>, inner: Text) -> Text {
    let Some(outer) = outer else { return inner };
    let mut parts = outer.template.parts.clone();
    parts.push(Part::Text(".".to_owned()));
    parts.extend(inner.template.parts);
    let source = format!("{}.{}", outer.source, inner.source);
    Text { line: inner.line, source, template: Template { parts } }
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
    let (items, of) = match (&item.content, kind) {
        (Content::List(items), Some(kind)) => match kind.strip_prefix("list_of_") {
            Some(of) => (items.as_slice(), Some(of)),
            None => return Err(entry.refuse(item.line, format!("value: is a list, must be of type {kind}"))),
        },
        (Content::List(items), None) => (items.as_slice(), None),
        (_, Some(kind)) if kind.starts_with("list_of_") => {
            return Err(entry.refuse(item.line, format!("value: is no list, must be of type {kind}")));
        }
        (_, kind) => (std::slice::from_ref(item), kind),
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
        match (given, of, first) {
            (Some(given), Some(of), _) if given != of => return wrong(of),
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
