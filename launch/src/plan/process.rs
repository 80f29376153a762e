//! From a `node` or `executable` action to what is started. Nothing is started
//! here.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::scope::{Scope, View};
use super::value::parameter_value;
use super::{ExecutablePlan, NodePlan, OnExit, Output, ProcessPlan, Respawn, command_line};
use crate::action::{ExecutableAction, NodeAction, Parameter, ProcessAction};
use crate::attributes::Text;
use crate::error::LaunchError;
use crate::substitution::SUITE;

/// ROS 2's default from SIGINT to SIGTERM, and from SIGTERM to SIGKILL.
const PATIENCE: Duration = Duration::from_secs(5);

/// Where a process is declared.
pub(super) struct Place<'a> {
    pub file: &'a Path,
    pub line: usize,
    pub view: View<'a>,
    pub scope: &'a Scope,
    /// The launcher's own environment.
    pub outside: &'a BTreeMap<String, String>,
    pub start_after: Duration,
}

/// The plan of an `executable` action.
pub(super) fn executable(
    action: &ExecutableAction,
    place: &Place<'_>,
) -> Result<ExecutablePlan, LaunchError> {
    let command = words(Some(&action.command), place)?;
    let Some(program) = command.first().filter(|program| !program.is_empty()) else {
        return Err(place.view.refuse(&action.command, "executable: cmd is empty"));
    };
    let name = place.view.optional(&action.process.name)?;
    let base =
        Path::new(program).file_name().map_or(program.clone(), |name| name.to_string_lossy().into_owned());
    let process = process(&action.process, name.unwrap_or(base), place)?;
    Ok(ExecutablePlan { command, process })
}

/// The plan of a `node` action.
pub(super) fn node(action: &NodeAction, place: &Place<'_>) -> Result<NodePlan, LaunchError> {
    let view = place.view;
    let package = view.string(&action.package)?;
    let executable = view.string(&action.executable)?;
    let given = view.optional(&action.process.name)?;
    let name = given.or_else(|| (package == SUITE).then(|| executable.clone()));
    let label = view.optional(&action.label)?.or_else(|| name.clone()).unwrap_or_else(|| executable.clone());
    let (parameter_files, parameters) = own_parameters(&action.parameters, place)?;
    let mut remaps = place.scope.remaps.clone();
    remaps.extend(view.pairs(&action.remaps)?);
    let namespace = place.scope.joined(&view.optional(&action.namespace)?.unwrap_or_default());
    check_names(name.as_deref(), &namespace, &remaps, place)?;
    Ok(NodePlan {
        package,
        executable,
        name,
        namespace,
        shared_parameters: place.scope.parameters.clone(),
        parameter_files,
        parameters,
        remaps,
        args: words(action.args.as_ref(), place)?,
        ros_args: words(action.ros_args.as_ref(), place)?,
        process: process(&action.process, label, place)?,
        declared_at: (place.file.to_owned(), place.line),
    })
}

fn check_names(
    name: Option<&str>,
    namespace: &str,
    remaps: &[(String, String)],
    place: &Place<'_>,
) -> Result<(), LaunchError> {
    modulo_runtime::NodeName::new(name.unwrap_or("unnamed"), namespace, remaps)
        .map(|_| ())
        .map_err(|e| LaunchError::at(place.file, place.line, format!("node: {e}")))
}

type Parameters = (Vec<PathBuf>, Vec<(String, super::ParameterText)>);

fn own_parameters(own: &[Parameter], place: &Place<'_>) -> Result<Parameters, LaunchError> {
    let (mut files, mut values) = (Vec::new(), Vec::new());
    for parameter in own {
        match parameter {
            Parameter::File(text) => {
                let path = PathBuf::from(place.view.string(text)?);
                if !path.is_file() {
                    let why = format!("param: from: {} is no file", path.display());
                    return Err(place.view.refuse(text, why));
                }
                files.push(path);
            }
            Parameter::Value { name, value, kind } => {
                let shown = place.view.string(name)?;
                if shown.is_empty() || shown.contains(":=") || shown.contains(char::is_whitespace) {
                    return Err(place.view.refuse(name, format!("param: '{shown}' is no parameter name")));
                }
                values.push((shown, parameter_value(name, value, *kind, place.view)?));
            }
        }
    }
    Ok((files, values))
}

fn words(text: Option<&Text>, place: &Place<'_>) -> Result<Vec<String>, LaunchError> {
    let Some(text) = text else { return Ok(Vec::new()) };
    place.view.locate(text, command_line::words(&text.template, &place.view.surroundings()))
}

fn process(action: &ProcessAction, label: String, place: &Place<'_>) -> Result<ProcessPlan, LaunchError> {
    let view = place.view;
    let seconds = |key: &str, text: &Option<Text>, default: Duration| match text {
        Some(text) => view.number(key, text).map(Duration::from_secs_f64),
        None => Ok(default),
    };
    Ok(ProcessPlan {
        label,
        env: environment(&view.pairs(&action.env)?, place),
        cwd: view.optional(&action.cwd)?.map(PathBuf::from),
        output: output(action.output.as_ref(), view)?,
        respawn: respawn(action, view)?,
        on_exit: on_exit(action.on_exit.as_ref(), view)?,
        sigterm_timeout: seconds("sigterm_timeout", &action.sigterm_timeout, PATIENCE)?,
        sigkill_timeout: seconds("sigkill_timeout", &action.sigkill_timeout, PATIENCE)?,
        start_after: place.start_after,
    })
}

/// How the environment at `place` with the `own` variables differs from the
/// launcher's.
fn environment(own: &[(String, String)], place: &Place<'_>) -> BTreeMap<String, Option<String>> {
    let (outside, inside) = (place.outside, &place.scope.environment);
    let removed = outside.keys().filter(|key| !inside.contains_key(*key)).map(|key| (key.clone(), None));
    let set = inside.iter().filter(|(key, value)| outside.get(*key) != Some(value));
    let set = set.map(|(key, value)| (key.clone(), Some(value.clone())));
    let own = own.iter().map(|(key, value)| (key.clone(), Some(value.clone())));
    removed.chain(set).chain(own).collect()
}

fn output(text: Option<&Text>, view: View<'_>) -> Result<Output, LaunchError> {
    let Some(text) = text else { return Ok(Output::default()) };
    match view.string(text)?.as_str() {
        "screen" | "both" => Ok(Output::Screen),
        "log" => Ok(Output::Log),
        other => Err(view.refuse(text, format!("output = '{other}' must be screen, both or log"))),
    }
}

fn on_exit(text: Option<&Text>, view: View<'_>) -> Result<OnExit, LaunchError> {
    let Some(text) = text else { return Ok(OnExit::Continue) };
    match view.string(text)?.as_str() {
        "shutdown" => Ok(OnExit::Shutdown),
        other => Err(view.refuse(text, format!("on_exit = '{other}' must be shutdown"))),
    }
}

fn respawn(action: &ProcessAction, view: View<'_>) -> Result<Respawn, LaunchError> {
    let wanted = action.respawn.as_ref().map(|text| view.bool("respawn", text)).transpose()?;
    let delay = action.respawn_delay.as_ref().map(|text| view.number("respawn_delay", text)).transpose()?;
    let max_retries = match &action.respawn_max_retries {
        None => None,
        Some(text) => {
            let value = view.string(text)?;
            let why = format!("respawn_max_retries = '{value}' must be a count, or -1 for any number");
            let number: i64 = value.trim().parse().map_err(|_| view.refuse(text, &why))?;
            if number < -1 {
                return Err(view.refuse(text, why));
            }
            u32::try_from(number).ok()
        }
    };
    Ok(match wanted {
        Some(true) => Respawn::After { delay: Duration::from_secs_f64(delay.unwrap_or(0.0)), max_retries },
        _ => Respawn::Never,
    })
}
