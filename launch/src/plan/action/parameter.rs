//! Reading the parameters of a node: name and value, or a file.

use std::fmt;
use std::path::{Path, PathBuf};

use modulo_runtime::embedded::locate;
use modulo_runtime::parameter::yaml_text::of_string;
use modulo_runtime::yaml::{self, Content, Item, ScalarType};

use crate::LaunchError;
use crate::plan::NodeParameter;
use crate::plan::attributes::{Attributes, is_plain};

const KEYS: [&str; 4] = ["name", "value", "type", "from"];
/// The types that the value of a parameter may have in the file.
const SCALARS: [ScalarType; 4] =
    [ScalarType::Integer, ScalarType::Float, ScalarType::Bool, ScalarType::String];
/// The types of ROS 2's launch files for a parameter that is no list.
const TYPES: [&str; 4] = ["int", "float", "bool", "str"];

/// Reads all parameters of a node.
pub(super) fn all(node: &Attributes<'_, '_>) -> Result<Vec<NodeParameter>, LaunchError> {
    node.entries("param", &KEYS)?.iter().map(parameter).collect()
}

fn parameter(entry: &Attributes<'_, '_>) -> Result<NodeParameter, LaunchError> {
    if let Some(file) = entry.text("from")? {
        if KEYS[..3].iter().any(|key| entry.item(key).is_some()) {
            return Err(entry.refuse(entry.line_of("from"), "'from' must be the only key of its entry"));
        }
        return entry.checked("from", existing(&file)).map(NodeParameter::File);
    }
    let name = entry.required("name")?;
    let item = entry.item("value").ok_or_else(|| entry.missing("value"))?;
    let kind = kind(entry)?;
    check_types(entry, item, kind)?;
    let is_name = !(name.is_empty() || name.contains(":=") || name.contains(char::is_whitespace));
    entry.checked(
        "name",
        is_name.then_some(()).ok_or_else(|| format!("param: '{name}' is no parameter name")),
    )?;
    let value = value(entry, item, kind)?.map_err(|why| format!("parameter '{name}' {why}"));
    Ok(NodeParameter::Value(name, entry.checked("name", value)?))
}

fn existing(file: &str) -> Result<PathBuf, String> {
    let path = locate(Path::new(file)).map_err(|why| why.to_string())?;
    if path.is_file() { Ok(path) } else { Err(format!("param: from: {} is no file", path.display())) }
}

fn kind(entry: &Attributes<'_, '_>) -> Result<Option<&'static str>, LaunchError> {
    let Some(given) = entry.plain("type")? else { return Ok(None) };
    let known = TYPES.iter().find(|kind| **kind == given).copied();
    let why = || format!("type: unknown '{given}', known are {}", TYPES.join(", "));
    known.map(Some).ok_or_else(|| entry.refuse(entry.line_of("type"), why()))
}

/// Checks the types of `item`. ROS 2 converts a string with a substitution to the type that is asked for, and nothing
/// else. The items of a list are of one type beside such strings.
fn check_types(entry: &Attributes<'_, '_>, item: &Item, kind: Option<&str>) -> Result<(), LaunchError> {
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

/// The value of a parameter in `item`, or why it is none. An empty list has no type in ROS 2.
fn value(
    entry: &Attributes<'_, '_>,
    item: &Item,
    kind: Option<&'static str>,
) -> Result<Result<ParameterText, String>, LaunchError> {
    // The text of a scalar and its type as it is written; `None` where a substitution decides on the type.
    let scalar = |item: &Item| -> Result<(String, Option<ScalarType>), LaunchError> {
        let pieces = entry.scalar("value", item, &SCALARS)?;
        let written = match item.content {
            Content::Scalar(_, kind) if is_plain(&pieces) => Some(kind),
            _ => None,
        };
        Ok((entry.joined(item, &pieces), written))
    };
    match &item.content {
        Content::List(items) if items.is_empty() => {
            let why = "value: an empty list has no type for ROS 2, leave the parameter out";
            Err(entry.refuse(item.line, why))
        }
        Content::List(items) => {
            Ok(Ok(ParameterText::list(items.iter().map(scalar).collect::<Result<_, _>>()?)))
        }
        _ => {
            let (text, written) = scalar(item)?;
            // As in ROS 2, a string without a substitution is a string, even if it looks like a number.
            let is_string = written == Some(ScalarType::String);
            Ok(ParameterText::scalar(text, kind.or(is_string.then_some("str"))))
        }
    }
}

/// The value of a parameter.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ParameterText {
    /// The value as text, a list as `[a, b]`.
    pub text: String,
    /// The type that the launch file asks for, such as `str`; that of a list is `None`.
    pub kind: Option<&'static str>,
}

impl ParameterText {
    /// A scalar; a `kind`, which is that of a scalar, is checked, and a `float` gets its decimal point.
    fn scalar(text: String, kind: Option<&'static str>) -> Result<Self, String> {
        let text = match kind {
            Some(of) => typed(text, of)?,
            // ROS 2 asks YAML for the type of a text, so the text must be a value to YAML.
            _ if is_value(&text) => text,
            _ => {
                return Err(format!(
                    "= '{text}' is neither a scalar nor a list to ROS 2, give it type: \"str\""
                ));
            }
        };
        Ok(Self { text, kind })
    }

    /// A list of (text, type as it is written).
    fn list(items: Vec<(String, Option<ScalarType>)>) -> Self {
        // Without quotes, ROS 2 would read the string '1' as a number.
        let item = |(text, kind): (String, _)| {
            if kind == Some(ScalarType::String) { of_string(&text) } else { text }
        };
        let items: Vec<String> = items.into_iter().map(item).collect();
        Self { text: format!("[{}]", items.join(", ")), kind: None }
    }
}

/// The text to write after `name:=` on a ROS 2 command line.
impl fmt::Display for ParameterText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.kind == Some("str") { f.write_str(&of_string(&self.text)) } else { f.write_str(&self.text) }
    }
}

fn typed(text: String, of: &str) -> Result<String, String> {
    let fits = match of {
        "int" => text.parse::<i64>().is_ok(),
        "float" => text.parse::<f64>().is_ok(),
        "bool" => ScalarType::of_plain(&text) == ScalarType::Bool,
        _ => true,
    };
    if !fits {
        return Err(format!("= {text} is no {of}"));
    }
    // ROS 2 reads `4` as an integer, which a parameter of type double does not take.
    Ok(if of == "float" && text.parse::<i64>().is_ok() { format!("{text}.0") } else { text })
}

/// Whether YAML's rules make a scalar or a list of scalars of `text`, and every reader of YAML the same one.
fn is_value(text: &str) -> bool {
    match yaml::read_agreed(text).map(|item| item.content) {
        Ok(Content::Scalar(_, kind)) => kind != ScalarType::Null,
        Ok(Content::List(items)) => {
            !items.is_empty() && items.iter().all(|item| matches!(item.content, Content::Scalar(..)))
        }
        Ok(Content::Map(_)) | Err(_) => false,
    }
}

#[cfg(test)]
mod tests {
    use modulo_runtime::parameter::{Value, yaml_text};
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// `\'` and `\u{7f}` of Rust are not YAML.
        #[test]
        fn a_string_reads_back(text in "[ -~\n\t\u{7f}\u{85}é']{0,8}") {
            let scalar = ParameterText::scalar(text.clone(), Some("str")).expect("any text is a string");
            prop_assert_eq!(yaml_text::string(&scalar.to_string()), Some(text.clone()));
            let list = ParameterText::list(vec![(text.clone(), Some(ScalarType::String))]);
            prop_assert_eq!(Value::Strings(Vec::new()).parse_like(&list.to_string()), Some(Value::Strings(vec![text])));
        }
    }
}
