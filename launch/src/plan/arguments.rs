//! The arguments of a launch file and of the files that it includes, also in branches not taken.

use std::path::{Path, PathBuf};

use super::scope::{Scope, argument_value, included};
use modulo_runtime::name::near_or_all;

use crate::LaunchError;
use crate::action::{self, Action, ActionKind, DeclaredArgument};

/// The arguments of the launch file `file`, in order, each once.
///
/// # Errors
/// As [`super::resolve`], for what cannot be read.
pub fn declared_arguments(file: &Path) -> Result<Vec<DeclaredArgument>, LaunchError> {
    declared(&absolute(file), &[])
}

/// Returns the declared arguments when `arguments` are given: the path of an included file may depend on them.
pub(super) fn declared(
    file: &Path,
    arguments: &[(String, String)],
) -> Result<Vec<DeclaredArgument>, LaunchError> {
    let launch_file = action::read_file(file)?;
    let mut collector = Collector {
        found: Vec::new(),
        fixed: Vec::new(),
        scope: Scope::new(arguments),
        open: vec![identity(file)],
    };
    collector.all(&launch_file.path, &launch_file.actions);
    Ok(collector.found)
}

/// Names the declared arguments for the end of an error about the argument `name`.
pub(super) fn known(name: &str, declared: &[DeclaredArgument]) -> String {
    let names: Vec<&str> = declared.iter().map(|d| d.name.as_str()).collect();
    if names.is_empty() {
        ", it declares no arguments".to_owned()
    } else {
        near_or_all(name, &names, ", declared are")
    }
}

/// The outermost file's path: `$(dirname)` is absolute in ROS, so that it means the same in an included file.
pub(super) fn absolute(file: &Path) -> PathBuf {
    std::path::absolute(file).unwrap_or_else(|_| file.to_owned())
}

/// The path by which a file is recognised when it includes itself.
pub(super) fn identity(file: &Path) -> PathBuf {
    file.canonicalize().unwrap_or_else(|_| file.to_owned())
}

struct Collector {
    found: Vec<DeclaredArgument>,
    /// Names to which an include that is being read gives the value.
    fixed: Vec<String>,
    scope: Scope,
    open: Vec<PathBuf>,
}

impl Collector {
    fn all(&mut self, file: &Path, actions: &[Action]) {
        for action in actions {
            match &action.kind {
                ActionKind::Argument(argument) => self.declare(file, argument),
                ActionKind::Group(children) => self.all(file, children),
                ActionKind::Include(include) => self.include(file, include),
                _ => {}
            }
        }
    }

    fn declare(&mut self, file: &Path, argument: &action::Argument) {
        let declared = &argument.declared;
        // A default that has no value yet is no error here: it may never be needed.
        if let Ok((name, value)) = argument_value(argument, self.scope.at(file)) {
            self.scope.variables.insert(name, value);
        }
        // A value from outside for an argument that an include gives would be ignored, so that it is not offered.
        let known =
            self.fixed.contains(&declared.name) || self.found.iter().any(|other| other.name == declared.name);
        self.found.extend((!known).then(|| declared.clone()));
    }

    fn include(&mut self, file: &Path, include: &action::Include) {
        let view = self.scope.at(file);
        // A file that is not there counts only if it is really included.
        let Ok(inner) = included(include, view) else { return };
        let identity = identity(&inner.path);
        // A file that includes itself is refused when the plan is made; here it would be read without end.
        if self.open.contains(&identity) {
            return;
        }
        let names: Vec<String> = include.arguments.iter().flat_map(|(name, _)| view.string(name)).collect();
        let values = view.pairs(&include.arguments).unwrap_or_default();
        // The path of a further include may depend on these values.
        self.scope.variables.extend(values);
        let outer = self.fixed.len();
        self.fixed.extend(names);
        self.open.push(identity);
        self.all(&inner.path, &inner.actions);
        self.open.pop();
        self.fixed.truncate(outer);
    }
}
