//! [`Scope`]: what holds at a place of a launch file. A group that is scoped
//! works on a copy.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::ParameterText;
use crate::attributes::Text;
use crate::error::LaunchError;
use crate::substitution::{SubstitutionError, Surroundings};
use crate::yaml::ScalarType;

/// What holds at a place of a launch file.
#[derive(Clone, Debug)]
pub(super) struct Scope {
    /// Arguments and `let`s.
    pub variables: BTreeMap<String, String>,
    /// The environment of processes started here.
    pub environment: BTreeMap<String, String>,
    /// The pushed namespace, absolute.
    pub namespace: String,
    /// From `set_parameter`.
    pub parameters: Vec<(String, ParameterText)>,
    /// From `set_remap`.
    pub remaps: Vec<(String, String)>,
    /// Variables that have no value because of a mistake.
    pub broken: BTreeSet<String>,
}

impl Scope {
    /// The outermost scope, with the values given on the command line.
    pub fn new(arguments: &[(String, String)]) -> Self {
        Self {
            variables: arguments.iter().cloned().collect(),
            environment: environment(),
            namespace: "/".to_owned(),
            parameters: Vec::new(),
            remaps: Vec::new(),
            broken: BTreeSet::new(),
        }
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

    /// A view of this scope from `file`.
    pub fn at<'a>(&'a self, file: &'a Path) -> View<'a> {
        View { file, scope: self }
    }
}

/// The launcher's environment; variables that are not text are left out.
pub(crate) fn environment() -> BTreeMap<String, String> {
    std::env::vars_os().filter_map(|(k, v)| Some((k.into_string().ok()?, v.into_string().ok()?))).collect()
}

/// A scope seen from a launch file: evaluates texts to values.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    file: &'a Path,
    scope: &'a Scope,
}

impl View<'_> {
    /// What templates refer to.
    pub fn surroundings(&self) -> Surroundings<'_> {
        let Scope { variables, environment, .. } = self.scope;
        Surroundings { file: self.file, variables, environment }
    }

    /// `result` with the line of `text` in its error.
    pub fn locate<T>(&self, text: &Text, result: Result<T, SubstitutionError>) -> Result<T, LaunchError> {
        result.map_err(|error| match &error {
            SubstitutionError::Undefined { name, .. } if self.scope.broken.contains(name) => {
                LaunchError::Consequence
            }
            _ => self.refuse(text, error),
        })
    }

    /// An error at `text`.
    pub fn refuse(&self, text: &Text, why: impl ToString) -> LaunchError {
        LaunchError::at(self.file, text.line, why.to_string())
    }

    /// The string.
    pub fn string(&self, text: &Text) -> Result<String, LaunchError> {
        self.locate(text, text.template.evaluate(&self.surroundings()))
    }

    /// The string, if there is a text.
    pub fn optional(&self, text: &Option<Text>) -> Result<Option<String>, LaunchError> {
        text.as_ref().map(|text| self.string(text)).transpose()
    }

    /// The strings of pairs.
    pub fn pairs(&self, pairs: &[(Text, Text)]) -> Result<Vec<(String, String)>, LaunchError> {
        pairs.iter().map(|(a, b)| Ok((self.string(a)?, self.string(b)?))).collect()
    }

    /// The bool, in YAML's words.
    pub fn bool(&self, key: &str, text: &Text) -> Result<bool, LaunchError> {
        let value = self.string(text)?;
        if ScalarType::of_plain(&value) != ScalarType::Bool {
            return Err(self.refuse(text, format!("{key} = '{value}' must be true or false")));
        }
        Ok(matches!(value.to_ascii_lowercase().as_str(), "true" | "yes" | "on"))
    }

    /// The number in `[0, 1e9]`.
    pub fn number(&self, key: &str, text: &Text) -> Result<f64, LaunchError> {
        let value = self.string(text)?;
        let number = value.trim().parse::<f64>().ok().filter(|n| (0.0..=1e9).contains(n));
        number.ok_or_else(|| self.refuse(text, format!("{key} = '{value}' must be a number in 0 to 1e9")))
    }
}
