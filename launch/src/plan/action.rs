//! The actions of a launch file, read and evaluated in a scope, or checked without one: a mistake that can be seen without values is
//! found also in branches that will not be taken. No other file is opened.

mod parameter;
mod process;

use std::path::{Path, PathBuf};

use modulo_runtime::input::{LARGEST_TEXT, read_text};
use modulo_runtime::yaml::{self, Content, Item, ScalarType};

use crate::LaunchError;
use crate::plan::attributes::Attributes;
use crate::plan::scope::Scope;
use crate::plan::{ExecutablePlan, NodePlan};
use crate::substitution::truth;

pub use parameter::ParameterText;

/// An action with its values; those below it, or in an included file, are not read yet.
pub(crate) enum Action<'f> {
    Argument(Argument),
    Group(&'f [Item]),
    PushNamespace(String),
    Include(Include),
    SetRemap(String, String),
    Node(Box<NodePlan>),
    Executable(Box<ExecutablePlan>),
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

pub(crate) struct Argument {
    /// The declaration. Its default is evaluated where the argument is.
    pub declared: DeclaredArgument,
    /// The value that was given, or the default.
    pub value: String,
}

pub(crate) struct Include {
    /// Line of its path, from 1.
    pub line: usize,
    pub file: PathBuf,
    /// Line, name and value of each of its arguments. A value that cannot be evaluated matters only where the file is really included.
    pub arguments: Vec<(usize, String, Result<String, LaunchError>)>,
}

/// The name of an action, and its keys besides `if` and `unless`.
const ACTIONS: [(&str, &[&[&str]]); 8] = [
    ("arg", &[&["name", "default", "description", "choice"]]),
    ("group", &[&["children"]]),
    ("push_ros_namespace", &[&["namespace"]]),
    ("push-ros-namespace", &[&["namespace"]]),
    ("include", &[&["file", "arg"]]),
    ("set_remap", &[&["from", "to"]]),
    ("node", &[process::NODE_KEYS, process::PROCESS_KEYS]),
    ("executable", &[&["cmd"], process::PROCESS_KEYS]),
];

/// Returns the actions of the launch file at `path`, which are not read yet.
pub(crate) fn read_file(path: &Path) -> Result<Vec<Item>, LaunchError> {
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
    let attributes = Attributes::read((path, None), "launch file", &root, &["launch"])?;
    if attributes.item("launch").is_none() {
        return Err(attributes.missing("launch"));
    }
    Ok(attributes.list("launch")?.to_vec())
}

/// Returns the language of ROS 2 in which a launch file is written that is not YAML.
fn other_language(path: &Path, text: &str) -> Option<&'static str> {
    let ends = |ending: &str| path.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending));
    let is_xml = ends("xml") || text.trim_start_matches('\u{feff}').trim_start().starts_with('<');
    if ends("py") { Some("Python") } else { is_xml.then_some("XML") }
}

/// Reads an action of `file`, with its line. Returns `None` where its condition does not hold in `scope`; without a scope, any action is checked.
pub(crate) fn read<'f>(
    file: &'f Path,
    item: &'f Item,
    scope: Option<&Scope>,
) -> Result<Option<(usize, Action<'f>)>, LaunchError> {
    let (key, body) = match &item.content {
        Content::Map(pairs) if pairs.len() == 1 => &pairs[0],
        _ => {
            let message = format!("expected one action '- name: attributes', found {}", item.described());
            return Err(LaunchError::at(file, item.line, message));
        }
    };
    let Some((name, keys)) = ACTIONS.iter().find(|(name, _)| *name == key.name) else {
        let known = ACTIONS.map(|(name, _)| name).join(", ");
        let message = format!(
            "action '{}' is not supported, supported are {known}; ros2 launch starts a file with other actions",
            key.name
        );
        return Err(LaunchError::at(file, key.line, message));
    };
    // ROS 2 takes a list right below `group` for its children.
    if let ("group", Content::List(children)) = (*name, &body.content) {
        return Ok(Some((key.line, Action::Group(children))));
    }
    let known: Vec<&str> = keys.iter().copied().flatten().chain(&["if", "unless"]).copied().collect();
    let mut attributes = Attributes::read((file, scope), name, body, &known)?;
    // A key that is missing has no line of its own: the error names that of the action.
    attributes.line = key.line;
    let applies = applies(&attributes)? || scope.is_none();
    applies.then(|| Ok((key.line, action(&attributes)?))).transpose()
}

fn action<'f>(a: &Attributes<'f, '_>) -> Result<Action<'f>, LaunchError> {
    Ok(match a.of {
        "arg" => Action::Argument(argument(a)?),
        "group" => Action::Group(a.list("children")?),
        "include" => Action::Include(include(a)?),
        "set_remap" => Action::SetRemap(a.required("from")?, a.required("to")?),
        "node" => Action::Node(Box::new(process::node(a)?)),
        "executable" => Action::Executable(Box::new(process::executable(a)?)),
        _ => Action::PushNamespace(a.required("namespace")?),
    })
}

fn applies(a: &Attributes<'_, '_>) -> Result<bool, LaunchError> {
    let (wanted, unwanted) = (a.text("if")?, a.text("unless")?);
    let holds = |key, text: &str| a.checked(key, truth(text).map_err(|why| format!("{key}: {why}")));
    match (wanted, unwanted, a.item("unless")) {
        (Some(_), _, Some(unless)) => Err(a.refuse(unless.line, "'if' and 'unless' exclude each other")),
        (Some(text), ..) => holds("if", &text),
        (None, Some(text), _) => holds("unless", &text).map(|holds| !holds),
        (None, None, _) => Ok(true),
    }
}

fn argument(a: &Attributes<'_, '_>) -> Result<Argument, LaunchError> {
    let name = a.plain("name")?.ok_or_else(|| a.missing("name"))?;
    let given = a.scope.and_then(|scope| scope.variables.get(&name).cloned());
    // A value that was given from outside, or by an earlier action, wins over the default, which may have none.
    let default = if given.is_some() { None } else { a.text("default")? };
    let choices = a.entries("choice", &["value"])?;
    let choices = choices.iter().map(|choice| choice.plain("value")?.ok_or_else(|| choice.missing("value")));
    let choices = choices.collect::<Result<Vec<_>, _>>()?;
    let value = given
        .or_else(|| default.clone())
        .ok_or_else(|| format!("argument '{name}' has no value and no default, give {name}:=VALUE"));
    let value = a.checked("name", value)?;
    let is_possible = choices.is_empty() || choices.contains(&value);
    let why = || format!("argument '{name}' = '{value}' must be one of {}", choices.join(", "));
    a.checked("name", is_possible.then_some(()).ok_or_else(why))?;
    let declared = DeclaredArgument { name, default, description: a.plain("description")?, choices };
    Ok(Argument { declared, value })
}

fn include(a: &Attributes<'_, '_>) -> Result<Include, LaunchError> {
    let file = a.required("file")?;
    let entries = a.entries("arg", &["name", "value"])?;
    let arguments = entries.iter().map(|one| Ok((one.line, one.required("name")?, one.required("value"))));
    Ok(Include {
        line: a.line_of("file"),
        file: file.into(),
        arguments: arguments.collect::<Result<_, LaunchError>>()?,
    })
}
