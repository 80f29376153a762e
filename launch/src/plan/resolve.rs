//! From a launch file and arguments to a [`Plan`]: actions are done in the order of the file, each in the scope that
//! the earlier ones left. Nothing is started.

use std::path::{Path, PathBuf};

use super::arguments::{self, absolute, identity};
use super::scope::{Scope, View, argument_value, included};
use super::{NodePlan, Plan, process};
use crate::LaunchError;
use crate::action::{self, Action, ActionKind, Include};
use crate::attributes::Text;
use crate::package::SUITE;
use crate::substitution::truth;

const CAMERA: &str = "modulo_camera";
/// The executable that ends with the frames of the camera in its namespace, and not when the camera crashes.
const END_OF_CAMERA: &str = "camera_end";

/// Reads `file` and works it out with `arguments`, the (name, value) pairs of the command line.
///
/// # Errors
/// [`LaunchError::At`] for a mistake in a file, [`LaunchError::Other`] for an argument that no file declares,
/// [`LaunchError::File`] when a file cannot be read.
///
/// ```
/// let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("recovered.launch.yaml");
/// let plan = modulo_launch::resolve(&file, &[("alpha".into(), "2.0".into())])?;
/// assert_eq!(plan.nodes.len(), 3);
/// # Ok::<(), modulo_launch::LaunchError>(())
/// ```
pub fn resolve(file: &Path, arguments: &[(String, String)]) -> Result<Plan, LaunchError> {
    let file = &absolute(file);
    let declared = arguments::declared(file, arguments)?;
    // An unknown argument is most often misspelt: the default would be used without a word.
    if let Some((name, _)) = arguments.iter().find(|(name, _)| declared.iter().all(|d| d.name != *name)) {
        let known = arguments::known(name, &declared);
        return Err(LaunchError::Other(format!("unknown launch argument '{name}'{known}")));
    }
    let launch_file = action::read_file(file)?;
    let mut resolver =
        Resolver { plan: Plan::default(), scope: Scope::new(arguments), open: vec![identity(file)] };
    resolver.all(&launch_file.path, &launch_file.actions)?;
    Ok(with_ends(resolver.plan))
}

/// Takes the nodes [`END_OF_CAMERA`] out of the plan: this launcher sees by itself whether a camera has crashed or has come to
/// its end, and ends the run in the second case. `ros2 launch` does not tell these two apart, and needs the node for it.
fn with_ends(mut plan: Plan) -> Plan {
    let is_end = |node: &NodePlan| node.package == SUITE && node.executable == END_OF_CAMERA;
    let ends: Vec<String> =
        plan.nodes.iter().filter(|node| is_end(node)).map(|node| node.namespace.clone()).collect();
    plan.nodes.retain(|node| !is_end(node));
    let cameras = plan.nodes.iter_mut().filter(|node| node.package == SUITE && node.executable == CAMERA);
    cameras
        .filter(|camera| ends.contains(&camera.namespace))
        .for_each(|camera| camera.process.ends_all = true);
    plan
}

struct Resolver {
    plan: Plan,
    scope: Scope,
    /// The files that are being read, outermost first.
    open: Vec<PathBuf>,
}

impl Resolver {
    fn all(&mut self, file: &Path, actions: &[Action]) -> Result<(), LaunchError> {
        actions.iter().try_for_each(|action| {
            let applies = applies(action.condition.as_ref(), self.scope.at(file))?;
            if applies { self.apply(file, action) } else { Ok(()) }
        })
    }

    fn apply(&mut self, file: &Path, action: &Action) -> Result<(), LaunchError> {
        let view = self.scope.at(file);
        match &action.kind {
            ActionKind::Argument(argument) => {
                let (name, value) = argument_value(argument, view)?;
                self.scope.variables.insert(name, value);
            }
            ActionKind::PushNamespace(namespace) => {
                self.scope.namespace = self.scope.joined(&view.string(namespace)?);
            }
            ActionKind::SetRemap(from, to) => {
                self.scope.remaps.push((view.string(from)?, view.string(to)?));
            }
            ActionKind::Group(children) => self.group(file, children)?,
            ActionKind::Include(include) => self.include(file, action.line, include)?,
            ActionKind::Node(node) => {
                self.plan.nodes.push(process::node(node, &self.site(file, action.line))?);
            }
            ActionKind::Executable(executable) => {
                let site = self.site(file, action.line);
                self.plan.executables.push(process::executable(executable, &site)?);
            }
        }
        Ok(())
    }

    fn site<'a>(&'a self, file: &'a Path, line: usize) -> process::DeclarationSite<'a> {
        process::DeclarationSite { file, line, view: self.scope.at(file), scope: &self.scope }
    }

    fn group(&mut self, file: &Path, children: &[Action]) -> Result<(), LaunchError> {
        let outer = self.scope.clone();
        self.all(file, children)?;
        self.scope = outer;
        Ok(())
    }

    /// As in ROS 2, an included file works in the scope of the including one.
    fn include(&mut self, file: &Path, line: usize, include: &Include) -> Result<(), LaunchError> {
        let view = self.scope.at(file);
        let launch_file = included(include, view)?;
        let arguments = view.pairs(&include.arguments)?;
        let identity = identity(&launch_file.path);
        if self.open.contains(&identity) {
            let why = format!("include: {} includes itself", launch_file.path.display());
            return Err(LaunchError::at(file, line, why));
        }
        // ROS 2 takes any name here: a misspelt one would leave the default of the file in place.
        let declared = arguments::declared(&launch_file.path, &[])?;
        for ((name, _), (text, _)) in arguments.iter().zip(&include.arguments) {
            if declared.iter().all(|d| d.name != *name) {
                let known = arguments::known(name, &declared);
                let path = launch_file.path.display();
                let why = format!("include: {path} declares no argument '{name}'{known}");
                return Err(view.refuse(text, why));
            }
        }
        self.scope.variables.extend(arguments);
        // The file counts as open only while it is read: to include it twice is no loop.
        self.open.push(identity);
        self.all(&launch_file.path, &launch_file.actions)?;
        self.open.pop();
        Ok(())
    }
}

fn applies(condition: Option<&(Text, bool)>, view: View<'_>) -> Result<bool, LaunchError> {
    let Some((text, wanted)) = condition else { return Ok(true) };
    let key = if *wanted { "if" } else { "unless" };
    let holds = truth(&view.string(text)?).map_err(|e| view.refuse(text, format!("{key}: {e}")))?;
    Ok(holds == *wanted)
}
