//! The rules of ROS 2's YAML frontend, written down from the sources of `launch`,
//! `launch_yaml` and `launch_ros` (jazzy) and not from our reader: every launch
//! file that comes with the suite keeps them, and each rule is seen to refuse.

use std::path::Path;

use saphyr::{LoadableYamlNode, Scalar, Yaml};

/// What an attribute may be.
enum Is {
    /// A string, which may hold substitutions.
    Text,
    /// A bool, nothing else: a string would be true whatever it says.
    Bool,
    /// A number with a decimal point, nothing else: a string is not converted, and fails later.
    Float,
    /// A number with a decimal point, or a string.
    FloatText,
    /// An integer, nothing else: a string is not converted, and fails later.
    Int,
    /// A parameter's value: a scalar or a list of one type.
    Value,
    /// A list of mappings with these attributes.
    Entities(&'static [(&'static str, Is)]),
    /// Actions.
    Actions,
    /// `param` inside a `param`.
    Nested,
}

use Is::{Actions, Bool, Entities, Float, FloatText, Int, Nested, Text, Value};

const PAIR: Is = Entities(&[("name", Text), ("value", Text)]);
const PARAM: &[(&str, Is)] =
    &[("name", Text), ("value", Value), ("type", Text), ("param", Nested), ("from", Text)];

/// Every action of the native subset with its attributes.
const ACTIONS: &[(&str, &[(&str, Is)])] = &[
    (
        "arg",
        &[("name", Text), ("default", Text), ("description", Text), ("choice", Entities(&[("value", Text)]))],
    ),
    ("let", &[("name", Text), ("value", Text)]),
    ("set_env", &[("name", Text), ("value", Text)]),
    ("unset_env", &[("name", Text)]),
    ("group", &[("scoped", Bool), ("children", Actions)]),
    ("push_ros_namespace", &[("namespace", Text)]),
    ("include", &[("file", Text), ("arg", PAIR)]),
    ("timer", &[("period", FloatText), ("children", Actions)]),
    ("log", &[("message", Text)]),
    ("set_parameter", &[("name", Text), ("value", Text)]),
    ("set_remap", &[("from", Text), ("to", Text)]),
    ("executable", &[("cmd", Text), ("name", Text)]),
    (
        "node",
        &[
            ("pkg", Text),
            ("exec", Text),
            ("name", Text),
            ("namespace", Text),
            ("args", Text),
            ("ros_args", Text),
            ("exec_name", Text),
            ("param", Entities(PARAM)),
            ("remap", Entities(&[("from", Text), ("to", Text)])),
        ],
    ),
];

/// What `node` and `executable` share.
const PROCESS: &[(&str, Is)] = &[
    ("env", PAIR),
    ("output", Text),
    // Not a bool: jazzy refuses one here.
    ("respawn", Text),
    ("respawn_delay", Float),
    ("respawn_max_retries", Int),
    ("cwd", Text),
    ("on_exit", Text),
    ("sigterm_timeout", Float),
    ("sigkill_timeout", Float),
];

const CONDITIONS: &[(&str, Is)] = &[("if", Text), ("unless", Text)];

/// Substitutions of ROS 2 that run neither Python nor a shell.
const SUBSTITUTIONS: [&str; 12] = [
    "var",
    "env",
    "dirname",
    "filename",
    "find-pkg-share",
    "find-pkg-prefix",
    "not",
    "and",
    "or",
    "equals",
    "not-equals",
    "if",
];

fn file(text: &str) -> Result<(), String> {
    let documents = Yaml::load_from_str(text).map_err(|why| why.to_string())?;
    let [Yaml::Mapping(root)] = documents.as_slice() else { return Err("no single mapping".into()) };
    match root.iter().next() {
        Some((key, body)) if root.len() == 1 && key.as_str() == Some("launch") => actions(body),
        _ => Err("'launch' must be the one root key".into()),
    }
}

fn actions(body: &Yaml<'_>) -> Result<(), String> {
    body.as_sequence().ok_or("actions must be a list")?.iter().try_for_each(action)
}

fn action(entry: &Yaml<'_>) -> Result<(), String> {
    let Some((key, body)) = entry.as_mapping().filter(|m| m.len() == 1).and_then(|m| m.iter().next()) else {
        return Err("an action must be a mapping of one key".into());
    };
    let name = key.as_str().unwrap_or_default();
    if let ("group", Yaml::Sequence(_)) = (name, body) {
        return actions(body);
    }
    let (_, own) = ACTIONS.iter().find(|(known, _)| *known == name).ok_or(format!("no action '{name}'"))?;
    let process = if matches!(name, "node" | "executable") { PROCESS } else { &[] };
    attributes(name, body, &[own, process, CONDITIONS])
}

fn attributes(of: &str, body: &Yaml<'_>, known: &[&[(&str, Is)]]) -> Result<(), String> {
    for (key, value) in body.as_mapping().ok_or(format!("{of}: no mapping"))? {
        let key = key.as_str().unwrap_or_default();
        let attribute = known.iter().flat_map(|group| group.iter()).find(|(name, _)| *name == key);
        let (_, is) = attribute.ok_or(format!("{of}: unexpected key '{key}'"))?;
        check(is, value).map_err(|why| format!("{of}: {key}: {why}"))?;
    }
    Ok(())
}

fn check(is: &Is, value: &Yaml<'_>) -> Result<(), String> {
    let scalar = match value {
        Yaml::Value(scalar) => Some(scalar),
        _ => None,
    };
    let fits = match (is, scalar) {
        (Actions, _) => return actions(value),
        (Entities(known), _) => return entities(value, known),
        (Nested, _) => return entities(value, PARAM),
        (Value, None) => {
            let items = value.as_sequence().filter(|items| !items.is_empty()).ok_or("no value")?;
            return items.iter().try_for_each(|item| check(&Value, item));
        }
        (Bool, Some(Scalar::Boolean(_))) => true,
        (Text | FloatText | Value, Some(Scalar::String(text))) => return substitutions(text),
        (Float | FloatText, Some(Scalar::FloatingPoint(_)))
        | (Int, Some(Scalar::Integer(_)))
        | (Value, Some(Scalar::Boolean(_) | Scalar::FloatingPoint(_) | Scalar::Integer(_))) => true,
        _ => false,
    };
    if fits { Ok(()) } else { Err(format!("is {value:?}")) }
}

fn entities(value: &Yaml<'_>, known: &[(&str, Is)]) -> Result<(), String> {
    let items = value.as_sequence().filter(|items| !items.is_empty()).ok_or("no list of mappings")?;
    items.iter().try_for_each(|item| attributes("entry", item, &[known]))
}

fn substitutions(text: &str) -> Result<(), String> {
    for call in text.split("$(").skip(1) {
        let name = call.split([' ', ')']).next().unwrap_or_default();
        if !SUBSTITUTIONS.contains(&name) {
            return Err(format!("no substitution $({name})"));
        }
    }
    Ok(())
}

#[test]
fn every_launch_file_of_the_suite_keeps_the_rules_of_ros() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut count = 0;
    for entry in std::fs::read_dir(folder).expect("readable").flatten() {
        let path = entry.path();
        if path.to_string_lossy().ends_with(".launch.yaml") {
            let text = std::fs::read_to_string(&path).expect("readable");
            assert_eq!(file(&text), Ok(()), "{}", path.display());
            count += 1;
        }
    }
    assert!(count >= 6, "{count} launch files");
}

/// Our reader accepts no file that these rules refuse.
#[test]
fn what_breaks_a_rule_is_refused_by_both() {
    for text in [
        "lunch: []",
        "launch: {}",
        "launch: []\nmore: []",
        "launch:\n  - log: { message: a }\n    let: { name: a, value: b }",
        "launch:\n  - nod: {}",
        "launch:\n  - log: { message: a, colour: b }",
        "launch:\n  - log: { message: 4 }",
        "launch:\n  - log: { message: a, if: true }",
        "launch:\n  - group: { scoped: 'false', children: [] }",
        "launch:\n  - timer: { period: 1, children: [] }",
        "launch:\n  - node: { pkg: p, exec: e, respawn_max_retries: 1.0 }",
        "launch:\n  - node: { pkg: p, exec: e, respawn_delay: 1 }",
        "launch:\n  - node: { pkg: p, exec: e, respawn_delay: '1.0' }",
        "launch:\n  - node: { pkg: p, exec: e, respawn_max_retries: '1' }",
        "launch:\n  - node: { pkg: p, exec: e, respawn: true }",
        "launch:\n  - executable: { cmd: e, respawn: true }",
        "launch:\n  - set_parameter: { name: a, value: 4.0 }",
        "launch:\n  - set_use_sim_time: { value: 'true' }",
        "launch:\n  - node: { pkg: p, exec: e, param: [] }",
        "launch:\n  - node: { pkg: p, exec: e, param: [{ name: a, value: [] }] }",
        "launch:\n  - node: { pkg: p, exec: e, param: [{ name: a, value: { b: 1 } }] }",
        "launch:\n  - node: { pkg: p, exec: e, remap: [{ from: a, into: b }] }",
        "launch:\n  - log: { message: \"$(eval '1')\" }",
        "launch:\n  - log: { message: \"$(command ls)\" }",
    ] {
        assert!(file(text).is_err(), "the rules: {text}");
        assert!(crate::Files::new(text).resolve(&[]).is_err(), "our reader: {text}");
    }
}
