//! The actions of a launch file, read but not yet evaluated: every mistake that
//! can be seen without values is found here, also in branches that will not be
//! taken. Nothing is evaluated and no other file is opened.

mod declaration;
mod process;
mod structure;
mod value;

use std::path::{Path, PathBuf};

pub(crate) use declaration::Argument;
pub(crate) use process::{ExecutableAction, NodeAction, ProcessAction};
pub(crate) use structure::Include;
pub(crate) use value::{Parameter, ParameterValue};

use crate::attributes::{Attributes, Text};
use crate::error::{LaunchError, Mistakes, listed};
use crate::yaml::{self, Content, Item};

/// A launch file.
#[derive(Clone, Debug)]
pub(crate) struct LaunchFile {
    /// Its path.
    pub path: PathBuf,
    /// Its actions in order.
    pub actions: Vec<Action>,
}

/// One entry of a launch file.
#[derive(Clone, Debug)]
pub(crate) struct Action {
    /// Line in the file, from 1.
    pub line: usize,
    /// Whether it is done at all.
    pub condition: Condition,
    /// What is done.
    pub kind: Kind,
}

/// Whether an action is done.
#[derive(Clone, Debug)]
pub(crate) enum Condition {
    Always,
    If(Text),
    Unless(Text),
}

/// What an action does.
#[derive(Clone, Debug)]
pub(crate) enum Kind {
    Argument(Argument),
    Let { name: Text, value: Text },
    SetEnvironment { name: Text, value: Text },
    UnsetEnvironment { name: Text },
    Group { scoped: Option<Text>, children: Vec<Action> },
    PushNamespace(Text),
    Include(Include),
    Timer { period: Text, children: Vec<Action> },
    Log(Text),
    SetParameter { name: Text, value: Text },
    SetRemap { from: Text, to: Text },
    Node(Box<NodeAction>),
    Executable(Box<ExecutableAction>),
}

/// Name of an action, its keys besides `if` and `unless`, and its reader.
struct Reader {
    name: &'static str,
    keys: &'static [&'static [&'static str]],
    read: fn(&Attributes<'_>) -> Result<Kind, Mistakes>,
}

const READERS: [Reader; 14] = [
    Reader {
        name: "arg",
        keys: &[&["name", "default", "description", "choice"]],
        read: declaration::argument,
    },
    Reader { name: "let", keys: &[&["name", "value"]], read: declaration::variable },
    Reader { name: "set_env", keys: &[&["name", "value"]], read: declaration::set_environment },
    Reader { name: "unset_env", keys: &[&["name"]], read: declaration::unset_environment },
    Reader { name: "group", keys: &[&["scoped", "children"]], read: structure::group },
    Reader { name: "push_ros_namespace", keys: &[&["namespace"]], read: structure::push_namespace },
    Reader { name: "push-ros-namespace", keys: &[&["namespace"]], read: structure::push_namespace },
    Reader { name: "include", keys: &[&["file", "arg"]], read: structure::include },
    Reader { name: "timer", keys: &[&["period", "children"]], read: structure::timer },
    Reader { name: "log", keys: &[&["message"]], read: structure::log },
    Reader { name: "set_parameter", keys: &[&["name", "value"]], read: structure::set_parameter },
    Reader { name: "set_remap", keys: &[&["from", "to"]], read: structure::set_remap },
    Reader { name: "node", keys: &[process::NODE_KEYS, process::PROCESS_KEYS], read: process::node },
    Reader { name: "executable", keys: &[&["cmd"], process::PROCESS_KEYS], read: process::executable },
];

/// Reads the launch file at `path`.
///
/// # Errors
/// [`LaunchError::File`] when it cannot be opened, [`LaunchError::At`] for each
/// action in it that is none.
pub(crate) fn read_file(path: &Path) -> Result<LaunchFile, Mistakes> {
    let text = std::fs::read_to_string(path).map_err(|e| LaunchError::file(path, e))?;
    let root = yaml::read(path, &text)?;
    let attributes = Attributes::read(path, "launch file", &root, &["launch"])?;
    if attributes.item("launch").is_none() {
        return Err(attributes.missing("launch").into());
    }
    Ok(LaunchFile { path: path.to_owned(), actions: read_all(path, attributes.list("launch")?)? })
}

/// Reads a list of actions.
fn read_all(file: &Path, items: &[Item]) -> Result<Vec<Action>, Mistakes> {
    Mistakes::gather(items.iter().map(|item| read(file, item)))
}

fn read(file: &Path, item: &Item) -> Result<Action, Mistakes> {
    let (key, body) = match &item.content {
        Content::Map(pairs) if pairs.len() == 1 => &pairs[0],
        _ => {
            let message = format!("expected one action '- name: attributes', found {}", item.described());
            return Err(LaunchError::at(file, item.line, message).into());
        }
    };
    if key.name == "set_use_sim_time" {
        // ROS 2 sets it for the launch process alone: no node would see what the file seems to promise.
        let why = "set_use_sim_time: ROS 2 does not set it for nodes; \
                   write set_parameter: { name: use_sim_time, value: \"true\" }";
        return Err(LaunchError::at(file, key.line, why).into());
    }
    let Some(reader) = READERS.iter().find(|reader| reader.name == key.name) else {
        let known = listed(READERS.iter().map(|reader| reader.name), "");
        let message = format!("unknown action '{}', known actions are {known}", key.name);
        return Err(LaunchError::at(file, key.line, message).into());
    };
    if let ("group", Content::List(children)) = (reader.name, &body.content) {
        let kind = Kind::Group { scoped: None, children: read_all(file, children)? };
        return Ok(Action { line: key.line, condition: Condition::Always, kind });
    }
    let known: Vec<&str> = reader.keys.iter().copied().flatten().chain(&["if", "unless"]).copied().collect();
    let mut attributes = Attributes::read(file, reader.name, body, &known)?;
    attributes.line = key.line;
    let condition = condition(&attributes)?;
    Ok(Action { line: key.line, condition, kind: (reader.read)(&attributes)? })
}

fn condition(attributes: &Attributes<'_>) -> Result<Condition, LaunchError> {
    match (attributes.text("if")?, attributes.text("unless")?) {
        (None, None) => Ok(Condition::Always),
        (Some(condition), None) => Ok(Condition::If(condition)),
        (None, Some(condition)) => Ok(Condition::Unless(condition)),
        (Some(_), Some(unless)) => {
            Err(attributes.refuse(unless.line, "'if' and 'unless' exclude each other"))
        }
    }
}
