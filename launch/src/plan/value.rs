//! The values of arguments and parameters at a place of a launch file.

use super::ParameterText;
use super::scope::View;
use crate::action::{Argument, ParameterValue};
use crate::attributes::Text;
use crate::error::{LaunchError, listed};
use crate::yaml::ScalarType;

/// Name and value of an argument: as given, else its default.
pub(super) fn argument_value(argument: &Argument, view: View<'_>) -> Result<(String, String), LaunchError> {
    let name = view.string(&argument.name)?;
    let value = match (view.surroundings().variables.get(&name), &argument.default) {
        (Some(value), _) => value.clone(),
        (None, Some(default)) => view.string(default)?,
        (None, None) => {
            let why = format!("argument '{name}' has no value and no default, give {name}:=VALUE");
            return Err(view.refuse(&argument.name, why));
        }
    };
    let choices: Result<Vec<String>, _> = argument.choices.iter().map(|choice| view.string(choice)).collect();
    let choices = choices?;
    if !choices.is_empty() && !choices.contains(&value) {
        let why = format!("argument '{name}' = '{value}' must be one of {}", listed(choices, ""));
        return Err(view.refuse(&argument.name, why));
    }
    Ok((name, value))
}

/// The value of the parameter `name`.
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
            ParameterText::list(values?, kind)
        }
    };
    checked.map_err(|why| view.refuse(name, format!("parameter '{}' {why}", name.source)))
}

/// The value of the parameter `name` for all nodes, which ROS 2 reads with YAML's rules and passes on as a scalar.
pub(super) fn shared_value(name: &Text, value: &Text, view: View<'_>) -> Result<ParameterText, LaunchError> {
    let checked = ParameterText::scalar(view.string(value)?, None);
    let scalar = checked.and_then(|value| match value.text.starts_with('[') {
        true => Err(format!("= {value} is a list, which ROS 2 does not pass on here")),
        false => Ok(value),
    });
    scalar.map_err(|why| view.refuse(name, format!("parameter '{}' {why}", name.source)))
}
