//! Reading `arg`, `let`, `set_env` and `unset_env`.

use super::Kind;
use crate::attributes::{Attributes, Text};
use crate::error::LaunchError;

/// A declared launch argument.
#[derive(Clone, Debug)]
pub(crate) struct Argument {
    /// Its name.
    pub name: Text,
    /// Its value when none is given.
    pub default: Option<Text>,
    /// What it is for.
    pub description: Option<Text>,
    /// The possible values; any when empty.
    pub choices: Vec<Text>,
}

pub(super) fn argument(attributes: &Attributes<'_>) -> Result<Kind, LaunchError> {
    let choices = attributes.entries("choice", &["value"])?;
    Ok(Kind::Argument(Argument {
        name: attributes.required("name")?,
        default: attributes.text("default")?,
        description: attributes.text("description")?,
        choices: choices.iter().map(|choice| choice.required("value")).collect::<Result<_, _>>()?,
    }))
}

pub(super) fn variable(attributes: &Attributes<'_>) -> Result<Kind, LaunchError> {
    Ok(Kind::Let { name: attributes.required("name")?, value: attributes.required("value")? })
}

pub(super) fn set_environment(attributes: &Attributes<'_>) -> Result<Kind, LaunchError> {
    Ok(Kind::SetEnvironment { name: attributes.required("name")?, value: attributes.required("value")? })
}

pub(super) fn unset_environment(attributes: &Attributes<'_>) -> Result<Kind, LaunchError> {
    Ok(Kind::UnsetEnvironment { name: attributes.required("name")? })
}
