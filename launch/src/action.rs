//! The actions of a launch file, read but not yet evaluated: a mistake that can be seen without values is found
//! here, also in branches that will not be taken. Nothing is evaluated and no other file is opened.

mod process;

use std::path::{Path, PathBuf};

pub(crate) use process::{ExecutableAction, NodeAction, Parameter, ParameterValue, ProcessAction};

use modulo_runtime::input::{LARGEST_TEXT, read_text};
use modulo_runtime::yaml::{self, Content, Item, ScalarType};

use crate::attributes::{Attributes, Text};
use crate::{LaunchError, listed};

#[derive(Clone, Debug)]
pub(crate) struct LaunchFile {
    pub path: PathBuf,
    pub actions: Vec<Action>,
}

#[derive(Clone, Debug)]
pub(crate) struct Action {
    /// Line in the file, from 1.
    pub line: usize,
    /// A condition, and the value of it with which the action is done; `None` for an action that is always done.
    pub condition: Option<(Text, bool)>,
    pub kind: ActionKind,
}

#[derive(Clone, Debug)]
pub(crate) enum ActionKind {
    Argument(Argument),
    Group(Vec<Action>),
    PushNamespace(Text),
    Include(Include),
    SetRemap(Text, Text),
    Node(Box<NodeAction>),
    Executable(Box<ExecutableAction>),
}

/// An argument of a launch file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeclaredArgument {
    /// Its name.
    pub name: String,
    /// Its value when none is given, as written; `None` when one must be given.
    pub default: Option<String>,
    /// Its purpose, for `--show-args`.
    pub description: Option<String>,
    /// The possible values; any when empty.
    pub choices: Vec<String>,
}

#[derive(Clone, Debug)]
pub(crate) struct Argument {
    /// Line of its name, from 1.
    pub line: usize,
    pub declared: DeclaredArgument,
    /// Its value when none is given.
    pub default: Option<Text>,
}

#[derive(Clone, Debug)]
pub(crate) struct Include {
    /// Its path; a relative one starts at the including file.
    pub file: Text,
    /// (name, value) of its arguments.
    pub arguments: Vec<(Text, Text)>,
}

/// The name of an action, its keys besides `if` and `unless`, and the function that reads it.
type ActionReader = (
    &'static str,
    &'static [&'static [&'static str]],
    fn(&Attributes<'_>) -> Result<ActionKind, LaunchError>,
);

const READERS: [ActionReader; 8] = [
    ("arg", &[&["name", "default", "description", "choice"]], argument),
    ("group", &[&["children"]], group),
    ("push_ros_namespace", &[&["namespace"]], push_namespace),
    ("push-ros-namespace", &[&["namespace"]], push_namespace),
    ("include", &[&["file", "arg"]], include),
    ("set_remap", &[&["from", "to"]], |a| Ok(ActionKind::SetRemap(a.required("from")?, a.required("to")?))),
    ("node", &[process::NODE_KEYS, process::PROCESS_KEYS], process::node),
    ("executable", &[&["cmd"], process::PROCESS_KEYS], process::executable),
];

/// Reads the launch file at `path`. An entry in it that is no action is a mistake.
pub(crate) fn read_file(path: &Path) -> Result<LaunchFile, LaunchError> {
    let text = read_text(path, LARGEST_TEXT).map_err(|e| LaunchError::file(path, e))?;
    if let Some(language) = other_language(path, &text) {
        let why = format!(
            "ROS 2 knows launch files in {language}, but only YAML is supported here; write it as .launch.yaml, or start it \
             with ros2 launch, which also starts the nodes of an installed suite"
        );
        return Err(LaunchError::file(path, why));
    }
    let root = yaml::read_agreed(&text).map_err(|e| LaunchError::at(path, e.line, e.message))?;
    if matches!(root.content, Content::Scalar(_, ScalarType::Null)) {
        return Err(LaunchError::at(path, root.line, "is empty, 'launch:' with a list is expected"));
    }
    let attributes = Attributes::read(path, "launch file", &root, &["launch"])?;
    if attributes.item("launch").is_none() {
        return Err(attributes.missing("launch"));
    }
    Ok(LaunchFile { path: path.to_owned(), actions: read_all(path, attributes.list("launch")?)? })
}

/// Returns the language of ROS 2 in which a launch file is written that is not YAML.
fn other_language(path: &Path, text: &str) -> Option<&'static str> {
    let ends = |ending: &str| path.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending));
    let is_xml = ends("xml") || text.trim_start_matches('\u{feff}').trim_start().starts_with('<');
    if ends("py") { Some("Python") } else { is_xml.then_some("XML") }
}

fn read_all(file: &Path, items: &[Item]) -> Result<Vec<Action>, LaunchError> {
    items.iter().map(|item| read(file, item)).collect()
}

fn read(file: &Path, item: &Item) -> Result<Action, LaunchError> {
    let (key, body) = match &item.content {
        Content::Map(pairs) if pairs.len() == 1 => &pairs[0],
        _ => {
            let message = format!("expected one action '- name: attributes', found {}", item.described());
            return Err(LaunchError::at(file, item.line, message));
        }
    };
    let Some((name, keys, reader)) = READERS.iter().find(|(name, ..)| *name == key.name) else {
        let known = listed(READERS.iter().map(|(name, ..)| name), "");
        let message = format!(
            "action '{}' is not supported, supported are {known}; ros2 launch starts a file with other actions",
            key.name
        );
        return Err(LaunchError::at(file, key.line, message));
    };
    // ROS 2 takes a list right below `group` for its children.
    if let ("group", Content::List(children)) = (*name, &body.content) {
        let kind = ActionKind::Group(read_all(file, children)?);
        return Ok(Action { line: key.line, condition: None, kind });
    }
    let known: Vec<&str> = keys.iter().copied().flatten().chain(&["if", "unless"]).copied().collect();
    let mut attributes = Attributes::read(file, name, body, &known)?;
    // A key that is missing has no line of its own: the error names that of the action.
    attributes.line = key.line;
    let condition = condition(&attributes)?;
    Ok(Action { line: key.line, condition, kind: reader(&attributes)? })
}

fn condition(attributes: &Attributes<'_>) -> Result<Option<(Text, bool)>, LaunchError> {
    match (attributes.text("if")?, attributes.text("unless")?) {
        (Some(_), Some(unless)) => {
            Err(attributes.refuse(unless.line, "'if' and 'unless' exclude each other"))
        }
        (wanted, unwanted) => Ok(wanted.map(|text| (text, true)).or(unwanted.map(|text| (text, false)))),
    }
}

fn argument(attributes: &Attributes<'_>) -> Result<ActionKind, LaunchError> {
    let choices = attributes.entries("choice", &["value"])?;
    let (name, default) = (required_plain(attributes, "name")?, attributes.text("default")?);
    let choices = choices.iter().map(|choice| Ok(required_plain(choice, "value")?.1));
    let declared = DeclaredArgument {
        name: name.1,
        default: default.as_ref().map(|text| text.source.clone()),
        description: attributes.plain("description")?.map(|(_, text)| text),
        choices: choices.collect::<Result<_, LaunchError>>()?,
    };
    Ok(ActionKind::Argument(Argument { line: name.0, declared, default }))
}

fn required_plain(attributes: &Attributes<'_>, key: &str) -> Result<(usize, String), LaunchError> {
    attributes.plain(key)?.ok_or_else(|| attributes.missing(key))
}

fn group(attributes: &Attributes<'_>) -> Result<ActionKind, LaunchError> {
    Ok(ActionKind::Group(read_all(attributes.file, attributes.list("children")?)?))
}

fn push_namespace(attributes: &Attributes<'_>) -> Result<ActionKind, LaunchError> {
    Ok(ActionKind::PushNamespace(attributes.required("namespace")?))
}

fn include(attributes: &Attributes<'_>) -> Result<ActionKind, LaunchError> {
    let file = attributes.required("file")?;
    Ok(ActionKind::Include(Include { file, arguments: attributes.pairs("arg", ["name", "value"])? }))
}
