//! The arguments of a launch file and of the files that it includes, also in branches not taken.

use std::path::{Path, PathBuf};

use modulo_runtime::name::near_or_all;
use modulo_runtime::yaml::Item;

use super::action::{self, Action, DeclaredArgument, Include};
use super::scope::Scope;
use crate::LaunchError;

/// The arguments of the launch file `file`, in order, each once.
///
/// # Errors
/// As [`super::resolve`], for what cannot be read.
pub fn declared_arguments(file: &Path) -> Result<Vec<DeclaredArgument>, LaunchError> {
    declared(&absolute(file), &[])
}

/// Checks each action of the file, whether it will be done or not. Returns the declared arguments when `arguments` are given: the path of an
/// included file may depend on them.
pub(super) fn declared(
    file: &Path,
    arguments: &[(String, String)],
) -> Result<Vec<DeclaredArgument>, LaunchError> {
    let actions = action::read_file(file)?;
    let mut collector = Collector {
        found: Vec::new(),
        fixed: Vec::new(),
        scope: Scope::new(arguments),
        open: vec![identity(file)],
    };
    collector.all(file, &actions)?;
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
    fn all(&mut self, file: &Path, actions: &[Item]) -> Result<(), LaunchError> {
        for item in actions {
            let Some((_, checked)) = action::read(file, item, None)? else { continue };
            // A text that has no value yet is no error here: it may never be needed.
            let known = |scope| action::read(file, item, Some(scope)).ok().flatten();
            match checked {
                Action::Group(children) => self.all(file, children)?,
                Action::Argument(argument) => {
                    let value = match known(&self.scope) {
                        Some((_, Action::Argument(known))) => known.value,
                        _ => String::new(),
                    };
                    self.declare(argument.declared, value);
                }
                Action::Include(Include { arguments, .. }) => {
                    arguments.into_iter().try_for_each(|(.., value)| value.map(drop))?;
                    if let Some((_, Action::Include(include))) = known(&self.scope) {
                        self.include(include);
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn declare(&mut self, declared: DeclaredArgument, value: String) {
        self.scope.variables.insert(declared.name.clone(), value);
        // A value from outside for an argument that an include gives would be ignored, so that it is not offered.
        let known =
            self.fixed.contains(&declared.name) || self.found.iter().any(|other| other.name == declared.name);
        self.found.extend((!known).then_some(declared));
    }

    fn include(&mut self, include: Include) {
        // A file that is not there, or has a mistake, counts only if it is really included.
        let Ok(actions) = action::read_file(&include.file) else { return };
        let identity = identity(&include.file);
        // A file that includes itself is refused when the plan is made; here it would be read without end.
        if include.file.is_relative() || self.open.contains(&identity) {
            return;
        }
        let outer = self.fixed.len();
        for (_, name, value) in include.arguments {
            // The path of a further include may depend on these values.
            self.scope.variables.extend(value.ok().map(|value| (name.clone(), value)));
            self.fixed.push(name);
        }
        self.open.push(identity);
        let _ = self.all(&include.file, &actions);
        self.open.pop();
        self.fixed.truncate(outer);
    }
}
