//! Files and arguments that a user writes.

use modulo_launch::substitution::Template;
use modulo_launch::{check, ros_arguments};
use modulo_runtime::parameter::file;
use modulo_runtime::ros_args::RosArgs;
use modulo_runtime::{NodeName, ParameterSet, Parameters, Value};
use modulo_unwrap::UnwrapParameters;

/// A launch file: what it plans can be started, and a text stays the text that it is.
pub fn launch(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let _ = Template::parse(text);
    let folder = super::folder(&[("a.launch.yaml", data)]);
    let Ok(plan) = check(&folder.path().join("a.launch.yaml"), &[]) else { return };
    for node in &plan.nodes {
        let _ = RosArgs::parse(&ros_arguments(node));
        for (name, text) in node.parameters.iter().filter(|(_, text)| text.kind == Some("str")) {
            let read = Value::String(String::new()).parse_like(&text.as_yaml());
            assert_eq!(read, Some(Value::String(text.text.clone())), "{name}");
        }
    }
}

/// A parameter file, and lines as arguments behind `--ros-args`; a value is written so that it reads back as the same.
pub fn parameters(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let folder = super::folder(&[("a.yaml", data)]);
    let node_name = NodeName::new("a", "/", &[]).expect("a name");
    let mut found = file::read(&folder.path().join("a.yaml"), &node_name).unwrap_or_default();
    let lines = std::iter::once("--ros-args").chain(text.lines().filter(|line| !line.contains("-file")));
    if let Ok((arguments, _)) = RosArgs::parse(&lines.map(str::to_owned).collect::<Vec<_>>())
        && let Ok(node_name) = arguments.node_name("a")
    {
        let _ = arguments.log_level_of("a");
        found.extend(arguments.parameters_for(&node_name).unwrap_or_default());
    }
    let kinds = [
        Value::Bool(false),
        Value::Integer(0),
        Value::Double(0.0),
        Value::String(String::new()),
        Value::Strings(Vec::new()),
    ];
    for (name, text) in &found {
        for value in kinds.iter().filter_map(|kind| kind.parse_like(text)) {
            let again = value.parse_like(&value.to_yaml());
            let is_nan = matches!(value, Value::Double(double) if double.is_nan());
            assert!(is_nan || again.as_ref() == Some(&value), "{name}: {value:?} became {again:?}");
        }
        let _ =
            Parameters::declare(UnwrapParameters::descriptors()).with_text(&[(name.clone(), text.clone())]);
    }
}
