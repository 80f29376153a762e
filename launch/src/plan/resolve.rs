//! From a launch file and arguments to a [`Plan`]: actions are done in the order of the file, each in the scope that
//! the earlier ones left. Nothing is started.

use std::path::{Path, PathBuf};

use modulo_runtime::yaml::Item;

use super::action::{self, Action, Include};
use super::arguments::{self, absolute, identity};
use super::scope::Scope;
use super::{NodePlan, Plan};
use crate::LaunchError;
use crate::package::SUITE;

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
    let actions = action::read_file(file)?;
    let mut resolver =
        Resolver { plan: Plan::default(), scope: Scope::new(arguments), open: vec![identity(file)] };
    resolver.all(file, &actions)?;
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
    fn all(&mut self, file: &Path, actions: &[Item]) -> Result<(), LaunchError> {
        for item in actions {
            if let Some((line, action)) = action::read(file, item, Some(&self.scope))? {
                self.apply(file, line, action)?;
            }
        }
        Ok(())
    }

    fn apply(&mut self, file: &Path, line: usize, action: Action<'_>) -> Result<(), LaunchError> {
        match action {
            Action::Argument(argument) => {
                self.scope.variables.insert(argument.declared.name, argument.value);
            }
            Action::PushNamespace(namespace) => self.scope.namespace = self.scope.joined(&namespace),
            Action::SetRemap(from, to) => self.scope.remaps.push((from, to)),
            Action::Group(children) => {
                let outer = self.scope.clone();
                self.all(file, children)?;
                self.scope = outer;
            }
            Action::Include(include) => self.include(file, line, include)?,
            Action::Node(node) => self.plan.nodes.push(*node),
            Action::Executable(executable) => self.plan.executables.push(*executable),
        }
        Ok(())
    }

    /// As in ROS 2, an included file works in the scope of the including one.
    fn include(&mut self, file: &Path, line: usize, include: Include) -> Result<(), LaunchError> {
        let actions = included(file, &include)?;
        let (path, identity) = (&include.file, identity(&include.file));
        if self.open.contains(&identity) {
            let why = format!("include: {} includes itself", path.display());
            return Err(LaunchError::at(file, line, why));
        }
        let declared = arguments::declared(path, &[])?;
        for (line, name, value) in include.arguments {
            // ROS 2 takes any name here: a misspelt one would leave the default of the file in place.
            if declared.iter().all(|d| d.name != name) {
                let known = arguments::known(&name, &declared);
                let path = path.display();
                let why = format!("include: {path} declares no argument '{name}'{known}");
                return Err(LaunchError::at(file, line, why));
            }
            self.scope.variables.insert(name, value?);
        }
        // The file counts as open only while it is read: to include it twice is no loop.
        self.open.push(identity);
        self.all(path, &actions)?;
        self.open.pop();
        Ok(())
    }
}

/// Reads the included file. A relative path is refused, which ROS 2 would look for in the folder of the start.
fn included(file: &Path, Include { line, file: path, .. }: &Include) -> Result<Vec<Item>, LaunchError> {
    let refuse = |why: String| LaunchError::at(file, *line, format!("include: {why}"));
    if path.is_relative() {
        let path = path.display();
        return Err(refuse(format!("'{path}' starts at any working folder, write $(dirname)/{path}")));
    }
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    if !name.ends_with(".yaml") && !name.ends_with(".yml") {
        return Err(refuse(format!("'{name}' is not YAML, only .launch.yaml files can be included")));
    }
    action::read_file(path).map_err(|mistake| match mistake {
        LaunchError::File(file, why) => refuse(format!("{}: {why}", file.display())),
        mistake => mistake,
    })
}
