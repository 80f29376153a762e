//! From a plan to a command line. Only the file system is asked where an
//! executable lies; nothing is started.

use std::path::{Path, PathBuf};

use super::start_error;
use crate::error::LaunchError;
use crate::plan::{ExecutablePlan, NodePlan, ProcessPlan, ros_arguments};
use crate::substitution::SUITE;

/// Program and arguments.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct CommandLine {
    pub program: PathBuf,
    pub arguments: Vec<String>,
}

/// A node of the suite is run by `suite`, another one from its package.
pub(super) fn of_node(node: &NodePlan, suite: &Path) -> Result<CommandLine, LaunchError> {
    let mut arguments = ros_arguments(node);
    if node.package == SUITE {
        arguments.splice(0..0, ["run".to_owned(), node.executable.clone()]);
        return Ok(CommandLine { program: suite.to_owned(), arguments });
    }
    Ok(CommandLine { program: installed(node)?, arguments })
}

/// The command of an `executable` action. The suite's own command is `suite`,
/// whether or not it is on the PATH.
pub(super) fn of_executable(executable: &ExecutablePlan, suite: &Path) -> CommandLine {
    let mut words = executable.command.iter().cloned();
    let program = match words.next() {
        Some(word) if word == SUITE => suite.to_owned(),
        word => word.expect("the plan of an executable has a command that is not empty").into(),
    };
    CommandLine { program, arguments: words.collect() }
}

fn installed(node: &NodePlan) -> Result<PathBuf, LaunchError> {
    let prefixes = variable(&node.process, "AMENT_PREFIX_PATH");
    let places: Vec<PathBuf> = prefixes
        .split(':')
        .filter(|prefix| !prefix.is_empty())
        .map(|prefix| Path::new(prefix).join("lib").join(&node.package).join(&node.executable))
        .collect();
    if let Some(program) = places.iter().find(|place| place.is_file()) {
        return Ok(program.clone());
    }
    let package = &node.package;
    Err(start_error(
        &node.process.label,
        if places.is_empty() {
            format!("package '{package}' is not found: AMENT_PREFIX_PATH is empty, is ROS 2 sourced?")
        } else {
            let places: Vec<String> = places.iter().map(|place| place.display().to_string()).collect();
            format!("executable is not found, looked at {}", places.join(", "))
        },
    ))
}

/// A variable as the process will see it.
fn variable(process: &ProcessPlan, name: &str) -> String {
    match process.env.get(name) {
        Some(value) => value.clone().unwrap_or_default(),
        None => std::env::var_os(name).unwrap_or_default().to_string_lossy().into_owned(),
    }
}
