//! The parts of launch files that ROS 2 allows and this launcher refuses, each with the reason and the remedy.

use std::path::Path;

const CONTAINER: &str = "it loads components, which are libraries of ROS 2, into one process; write each as 'node', and \
                         `modulo launch --compose` runs the nodes of the suite in one process";
const LIFECYCLE: &str = "the suite has no managed nodes; write 'node', and pause it by its service ~/enable";
const PYTHON: &str =
    "ROS 2 has it in launch files of Python only; on_exit and respawn say what follows the end of a process";
const EACH: &str = "nothing is repeated; write each action, or include a file once for each";
const ENVIRONMENT: &str = "write set_env with the whole value, such as \"$(env PATH):/more\"";
const ROS2_LAUNCH: &str =
    "start the file with ros2 launch, which also starts the nodes of an installed suite";
const VARIABLES: &str = "a group with its scope ends the changes of 'let' and 'arg'";
const LOGS: &str = "write log: { message: TEXT }";
const TERMINAL: &str = "output is shown on the terminal and no log folder is kept";

/// The actions of ROS 2 Jazzy and of later releases that are not supported.
const ACTIONS: [(&str, &str); 30] = [
    ("node_container", CONTAINER),
    ("composable_node", CONTAINER),
    ("load_composable_node", CONTAINER),
    ("lifecycle_node", LIFECYCLE),
    ("lifecycle_transition", LIFECYCLE),
    ("event_handler", PYTHON),
    ("register_event_handler", PYTHON),
    ("emit_event", PYTHON),
    ("opaque_function", PYTHON),
    ("for", EACH),
    ("for_each", EACH),
    ("append_env", ENVIRONMENT),
    ("rep_env", ENVIRONMENT),
    ("reset_env", ENVIRONMENT),
    ("reset", VARIABLES),
    ("unset", VARIABLES),
    ("bool_arg", "write arg with choice: [{ value: \"true\" }, { value: \"false\" }]"),
    ("scoped_include", "write include within a group"),
    ("log_debug", LOGS),
    ("log_info", LOGS),
    ("log_warning", LOGS),
    ("log_error", LOGS),
    ("timer", ROS2_LAUNCH),
    ("ros_timer", ROS2_LAUNCH),
    ("unset_env", ROS2_LAUNCH),
    ("set_parameters_from_file", "write param: [{ from: FILE }] at each node"),
    ("set_ros_log_dir", TERMINAL),
    ("set_log_dir", TERMINAL),
    ("shutdown", "write on_exit: shutdown at the process whose end is to end the run"),
    // ROS 2 sets it for the launch process alone: no node would see what the file seems to promise.
    (
        "set_use_sim_time",
        "ROS 2 does not set it for nodes; write set_parameter: { name: use_sim_time, value: \"true\" }",
    ),
];

/// The attributes of ROS 2 that are not supported, of whatever action.
const ATTRIBUTES: [(&str, &str); 13] = [
    (
        "launch-prefix",
        "the program that it names would be the process; write executable: { cmd: ... } with the whole command, such as \
         \"gdb -ex run --args modulo run detector\"",
    ),
    ("shell", "no shell is run; write the shell into cmd, such as \"sh -c 'COMMAND'\""),
    ("emulate_tty", "output goes to the terminal of the launch as it is; leave it out"),
    ("output_format", "output goes to the terminal of the launch as it is; leave it out"),
    ("log_cmd", "`modulo launch --print` prints the commands; leave it out"),
    ("additional_env", "write env: [{ name: NAME, value: VALUE }]"),
    ("autostart", LIFECYCLE),
    ("composable_node", CONTAINER),
    ("forwarding", VARIABLES),
    ("keep", VARIABLES),
    ("let", "write arg for the arguments of the included file"),
    ("allow_substs", "a parameter file is read as it is; write the parameter as name and value"),
    ("level", "messages are shown whatever their level is; leave it out"),
];

/// Returns why the action or attribute `name` of ROS 2 is refused; `None` for a name that ROS 2 does not know either.
pub(crate) fn reason(what: &str, name: &str) -> Option<String> {
    let list: &[(&str, &str)] = if what == "action" { &ACTIONS } else { &ATTRIBUTES };
    let (_, why) = list.iter().find(|(known, _)| *known == name)?;
    Some(format!("{name}: ROS 2 knows this {what}, but it is not supported here: {why}"))
}

/// Returns why the launch file at `path` with `text` is refused, if it is one of ROS 2 in another language.
pub(crate) fn language(path: &Path, text: &str) -> Option<String> {
    let ends = |ending: &str| path.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending));
    let language = if ends("py") {
        "Python"
    } else if ends("xml") || text.trim_start_matches('\u{feff}').trim_start().starts_with('<') {
        "XML"
    } else {
        return None;
    };
    Some(format!(
        "ROS 2 knows launch files in {language}, but only YAML is supported here; write it as .launch.yaml, or start it \
         with ros2 launch, which also starts the nodes of an installed suite"
    ))
}
