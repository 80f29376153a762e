//! Reading `arg`, `let`, `set_env` and `unset_env`.

use super::Kind;
use crate::attributes::{Attributes, Text};
use crate::error::{LaunchError, Mistakes};

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

pub(super) fn argument(attributes: &Attributes<'_>) -> Result<Kind, Mistakes> {
    let choices = attributes.entries("choice", &["value"])?;
    Ok(Kind::Argument(Argument {
        name: attributes.plain("name")?.ok_or_else(|| attributes.missing("name"))?,
        default: attributes.text("default")?,
        description: attributes.plain("description")?,
        choices: choices.iter().map(choice).collect::<Result<_, _>>()?,
    }))
}

fn choice(choice: &Attributes<'_>) -> Result<Text, LaunchError> {
    choice.plain("value")?.ok_or_else(|| choice.missing("value"))
}

pub(super) fn variable(attributes: &Attributes<'_>) -> Result<Kind, Mistakes> {
    Ok(Kind::Let { name: attributes.required("name")?, value: attributes.required("value")? })
}

pub(super) fn set_environment(attributes: &Attributes<'_>) -> Result<Kind, Mistakes> {
    Ok(Kind::SetEnvironment { name: attributes.required("name")?, value: attributes.required("value")? })
}

pub(super) fn unset_environment(attributes: &Attributes<'_>) -> Result<Kind, Mistakes> {
    Ok(Kind::UnsetEnvironment { name: attributes.required("name")? })
}
