//! [`Scope`]: the variables, the namespace and the remappings at a place of a launch file.
//! [`View`] evaluates texts there. A group that is scoped works on a copy.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use modulo_runtime::parameter::yaml_text::of_string;
use modulo_runtime::yaml::{self, Content, ScalarType};

use crate::action::{self, Argument, DeclaredArgument, Include, LaunchFile, ParameterValue};
use crate::attributes::Text;
use crate::substitution::{SubstitutionError, Surroundings};
use crate::{LaunchError, listed};

/// The state at a place of a launch file, as the actions before it have left it.
#[derive(Clone, Debug, Default)]
pub(super) struct Scope {
    /// The values of the arguments.
    pub variables: BTreeMap<String, String>,
    /// The pushed namespace, absolute.
    pub namespace: String,
    /// The rules of `set_remap`.
    pub remaps: Vec<(String, String)>,
}

impl Scope {
    /// The outermost scope, with the values given on the command line.
    pub fn new(arguments: &[(String, String)]) -> Self {
        Self { variables: arguments.iter().cloned().collect(), namespace: "/".to_owned(), ..Self::default() }
    }

    /// Joins `name` to the namespace; an absolute one replaces it.
    pub fn joined(&self, name: &str) -> String {
        let name = name.trim_end_matches('/');
        match name {
            "" => self.namespace.clone(),
            absolute if absolute.starts_with('/') => absolute.to_owned(),
            relative => format!("{}/{relative}", self.namespace.trim_end_matches('/')),
        }
    }

    pub fn at<'a>(&'a self, file: &'a Path) -> View<'a> {
        View { file, scope: self }
    }
}

/// A scope seen from a launch file: evaluates texts to values.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    file: &'a Path,
    scope: &'a Scope,
}

impl View<'_> {
    /// Returns the values that templates can refer to.
    pub fn surroundings(&self) -> Surroundings<'_> {
        Surroundings { file: self.file, variables: &self.scope.variables }
    }

    /// Returns `result`, with the line of `text` in its error.
    pub fn locate<T>(&self, text: &Text, result: Result<T, SubstitutionError>) -> Result<T, LaunchError> {
        result.map_err(|error| self.refuse(text, error))
    }

    pub fn refuse(&self, text: &Text, why: impl ToString) -> LaunchError {
        LaunchError::at(self.file, text.line, why.to_string())
    }

    pub fn string(&self, text: &Text) -> Result<String, LaunchError> {
        self.locate(text, text.template.evaluate(&self.surroundings()))
    }

    pub fn optional(&self, text: &Option<Text>) -> Result<Option<String>, LaunchError> {
        text.as_ref().map(|text| self.string(text)).transpose()
    }

    pub fn pairs(&self, pairs: &[(Text, Text)]) -> Result<Vec<(String, String)>, LaunchError> {
        pairs.iter().map(|(a, b)| Ok((self.string(a)?, self.string(b)?))).collect()
    }

    /// Evaluates `text` to a bool as YAML writes it: `true`, `yes`, `on` and their opposites.
    pub fn bool(&self, key: &str, text: &Text) -> Result<bool, LaunchError> {
        let value = self.string(text)?;
        if ScalarType::of_plain(&value) != ScalarType::Bool {
            return Err(self.refuse(text, format!("{key} = '{value}' must be true or false")));
        }
        Ok(matches!(value.to_ascii_lowercase().as_str(), "true" | "yes" | "on"))
    }

    /// Evaluates `text` to a number in `[0, 1e9]`.
    pub fn number(&self, key: &str, text: &Text) -> Result<f64, LaunchError> {
        let value = self.string(text)?;
        // `Duration` refuses negative, infinite and huge numbers with a panic, so they end here.
        let number = value.trim().parse::<f64>().ok().filter(|n| (0.0..=1e9).contains(n));
        number.ok_or_else(|| self.refuse(text, format!("{key} = '{value}' must be a number in 0 to 1e9")))
    }
}

/// Name and value of an argument: as given, else its default.
pub(super) fn argument_value(argument: &Argument, view: View<'_>) -> Result<(String, String), LaunchError> {
    let DeclaredArgument { name, choices, .. } = &argument.declared;
    let value = match (view.surroundings().variables.get(name), &argument.default) {
        // A value that was given from outside, or by an earlier action, wins over the default.
        (Some(value), _) => value.clone(),
        (None, Some(default)) => view.string(default)?,
        (None, None) => {
            let why = format!("argument '{name}' has no value and no default, give {name}:=VALUE");
            return Err(LaunchError::at(view.file, argument.line, why));
        }
    };
    if !choices.is_empty() && !choices.contains(&value) {
        let why = format!("argument '{name}' = '{value}' must be one of {}", listed(choices, ""));
        return Err(LaunchError::at(view.file, argument.line, why));
    }
    Ok((name.clone(), value))
}

pub(super) fn parameter_value(
    name: &Text,
    value: &ParameterValue,
    kind: Option<&'static str>,
    view: View<'_>,
) -> Result<ParameterText, LaunchError> {
    let checked = match value {
        // As in ROS 2, a string without a substitution is a string, even if it looks like a number.
        ParameterValue::Scalar((text, written)) => {
            let is_string = *written == Some(ScalarType::String);
            ParameterText::scalar(view.string(text)?, kind.or(is_string.then_some("str")))
        }
        ParameterValue::List(items) => {
            let values: Result<Vec<_>, LaunchError> =
                items.iter().map(|(text, kind)| Ok((view.string(text)?, *kind))).collect();
            Ok(ParameterText::list(values?))
        }
    };
    checked.map_err(|why| view.refuse(name, format!("parameter '{}' {why}", name.source)))
}

/// Reads the included file. A relative path is refused, which ROS 2 would look for in the folder of the start.
pub(super) fn included(include: &Include, view: View<'_>) -> Result<LaunchFile, LaunchError> {
    let path = PathBuf::from(view.string(&include.file)?);
    if path.is_relative() {
        let path = path.display();
        let why = format!("include: '{path}' starts at any working folder, write $(dirname)/{path}");
        return Err(view.refuse(&include.file, why));
    }
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    if !name.ends_with(".yaml") && !name.ends_with(".yml") {
        let why = format!("include: '{name}' is not YAML, only .launch.yaml files can be included");
        return Err(view.refuse(&include.file, why));
    }
    action::read_file(&path).map_err(|mistake| match mistake {
        LaunchError::File(file, why) => {
            view.refuse(&include.file, format!("include: {}: {why}", file.display()))
        }
        mistake => mistake,
    })
}

/// The value of a parameter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParameterText {
    /// The value as text, a list as `[a, b]`.
    pub text: String,
    /// The type that the launch file asks for, such as `str`; that of a list is `None`.
    pub kind: Option<&'static str>,
}

impl ParameterText {
    /// A scalar; a `kind`, which is that of a scalar, is checked, and a `float` gets its decimal point.
    pub(super) fn scalar(text: String, kind: Option<&'static str>) -> Result<Self, String> {
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
    pub(super) fn list(items: Vec<(String, Option<ScalarType>)>) -> Self {
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
