//! [`Scope`]: the variables, the namespace and the remappings at a place of a launch file, as the actions before it have left them.

use std::collections::BTreeMap;

#[derive(Clone, Debug, Default)]
pub(crate) struct Scope {
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
}
