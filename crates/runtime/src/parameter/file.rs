//! Parameter files as `rcl_yaml_param_parser` reads and `ros2 param dump` writes them:
//!
//! ```yaml
//! /**:                      # any node; /* is one part of a name, /** any number
//!   ros__parameters:
//!     angle: 4.0
//! /front/unwrap:            # or nested: front: {unwrap: {ros__parameters: ...}}
//!   ros__parameters:
//!     trust: {limit: 0.5}   # the parameter trust.limit
//! ```
//!
//! Later entries win over earlier ones. No type is known here: values stay text.

use std::path::Path;

use modulo_msgs::rcl_interfaces::ParameterValue;

use crate::embedded::locate;
use crate::input::{LARGEST_TEXT, read_text};
use crate::name::NodeName;
use crate::parameter::value::{Yaml, from_ros};
use crate::parameter::yaml_text;
use crate::ros_args::{ArgsError, RosArgs, Setting};
use crate::yaml::{self, Content, Item, Key};

/// The key under which a node's parameters stand.
const PARAMETERS: &str = "ros__parameters";

impl RosArgs {
    /// Parameters for the node `node_name` as (name, text), in order.
    ///
    /// # Errors
    /// [`ArgsError::File`] when a parameter file cannot be read.
    pub fn parameters_for(&self, node_name: &NodeName) -> Result<Vec<(String, String)>, ArgsError> {
        let mut found = Vec::new();
        for setting in &self.parameters {
            match setting {
                Setting::Value(rule) if rule.is_for(&node_name.name) => {
                    found.push((rule.name.clone(), rule.value.clone()));
                }
                Setting::Value(_) => {}
                Setting::File(path) => found.extend(read(path, node_name)?),
            }
        }
        Ok(found)
    }
}

/// Returns the parameters in the file at `path`, which may be a sensor file of the suite, for the node `node_name`, as (name, text), in order.
///
/// # Errors
/// [`ArgsError::File`] when it cannot be read or is no parameter file.
pub fn read(path: &Path, node_name: &NodeName) -> Result<Vec<(String, String)>, ArgsError> {
    Ok(entries(path, node_name)?.into_iter().map(|entry| (entry.name, entry.text)).collect())
}

/// Returns the entries of the file at `path` for the node `node_name`, in order.
///
/// # Errors
/// The same as those of [`read`].
pub fn entries(path: &Path, node_name: &NodeName) -> Result<Vec<Entry>, ArgsError> {
    let wrong = |why: String| ArgsError::File(path.display().to_string(), why);
    let text =
        locate(path).and_then(|path| read_text(&path, LARGEST_TEXT)).map_err(|why| wrong(why.to_string()))?;
    parse(&text, node_name).map_err(wrong)
}

/// A parameter in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Its name.
    pub name: String,
    /// Its value as text.
    pub text: String,
    /// Whether the file names the node, and not several nodes by a wildcard.
    pub by_name: bool,
}

fn parse(text: &str, node_name: &NodeName) -> Result<Vec<Entry>, String> {
    let root = yaml::read(text).map_err(|why| why.to_string())?;
    let Content::Map(nodes) = &root.content else {
        return Err("must be one mapping of node names".into());
    };
    let mut found = Vec::new();
    for (name, body) in nodes {
        node(&name.name, body, node_name, &mut found)?;
    }
    Ok(found)
}

/// Reads the entry of one node, or of a namespace with several nodes.
fn node(pattern: &str, body: &Item, node_name: &NodeName, found: &mut Vec<Entry>) -> Result<(), String> {
    let Content::Map(entries) = &body.content else {
        return Err(format!("'{pattern}' has no mapping '{PARAMETERS}'"));
    };
    for (Key { name, .. }, value) in entries {
        // Any other key continues the name: a node in this namespace, or a further part of it.
        if name != PARAMETERS {
            node(&format!("{pattern}/{name}"), value, node_name, found)?;
            continue;
        }
        let Content::Map(parameters) = &value.content else {
            return Err(format!("'{PARAMETERS}' of '{pattern}' must be a mapping"));
        };
        for (name, value) in parameters {
            let mut all = Vec::new();
            flatten(&name.name, value, &mut all)?;
            // Entries of other nodes are read as well, so that a mistake in them is found here.
            let by_name = !pattern.contains('*');
            let all = all.into_iter().map(|(name, text)| Entry { name, text, by_name });
            found.extend(all.filter(|_| matches(pattern, node_name)));
        }
    }
    Ok(())
}

/// Returns whether a pattern, with `*` for one part of a name and `**` for any number, means the node `node_name`.
fn matches(pattern: &str, node_name: &NodeName) -> bool {
    fn all(pattern: &[&str], name: &[&str]) -> bool {
        match (pattern, name) {
            ([], []) => true,
            // Two stars mean any number of parts, so every rest of the name is tried.
            (["**", rest @ ..], _) => (0..=name.len()).any(|skip| all(rest, &name[skip..])),
            (["*", rest @ ..], [_, name @ ..]) => all(rest, name),
            ([part, rest @ ..], [first, name @ ..]) => part == first && all(rest, name),
            _ => false,
        }
    }
    all(&parts(pattern), &parts(&node_name.fully_qualified()))
}

fn parts(name: &str) -> Vec<&str> {
    name.split('/').filter(|part| !part.is_empty()).collect()
}

/// Adds the parameters of `value` to `found`; nested mappings become names with dots.
fn flatten(name: &str, value: &Item, found: &mut Vec<(String, String)>) -> Result<(), String> {
    let no_value = || format!("parameter '{name}' has no value that a parameter can have");
    let text = match &value.content {
        Content::Map(inner) => {
            return inner
                .iter()
                .try_for_each(|(part, value)| flatten(&format!("{name}.{}", part.name), value, found));
        }
        Content::List(items) => {
            let items: Option<Vec<String>> = items.iter().map(yaml_text::scalar).collect();
            format!("[{}]", items.ok_or_else(no_value)?.join(", "))
        }
        Content::Scalar(..) => yaml_text::scalar(value).ok_or_else(no_value)?,
    };
    found.push((name.to_owned(), text));
    Ok(())
}

/// Returns the text that `ros2 param dump` prints: the parameters of the fully qualified `node`, sorted by name, with
/// nesting for dots. Parameters that are not set are left out.
pub fn write(node: &str, parameters: &[(String, ParameterValue)]) -> String {
    let mut sorted: Vec<_> = parameters.iter().collect();
    // Compared part by part, so that all names of a group follow each other.
    sorted.sort_by(|a, b| a.0.split('.').cmp(b.0.split('.')));
    let mut text = format!("{node}:\n  {PARAMETERS}:\n");
    let mut open: Vec<&str> = Vec::new();
    for (name, value) in sorted {
        // `rcl` has no notation for a parameter that is not set.
        let Some(value) = from_ros(value.clone()) else { continue };
        let (groups, last) = name.rsplit_once('.').unwrap_or(("", name));
        let groups: Vec<&str> = groups.split('.').filter(|group| !group.is_empty()).collect();
        // Groups that the last name has opened and this one shares are not written again.
        let common = open.iter().zip(&groups).take_while(|(a, b)| a == b).count();
        open.truncate(common);
        for group in &groups[common..] {
            text += &format!("{:1$}{group}:\n", "", 4 + 2 * open.len());
            open.push(group);
        }
        let indent = " ".repeat(4 + 2 * open.len());
        text += &match value.yaml() {
            Yaml::Scalar(scalar) => format!("{indent}{last}: {scalar}\n"),
            Yaml::List(items) if items.is_empty() => format!("{indent}{last}: []\n"),
            Yaml::List(items) => {
                let items: String = items.iter().map(|item| format!("{indent}- {item}\n")).collect();
                format!("{indent}{last}:\n{items}")
            }
        };
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameter::Value;
    use crate::parameter::to_ros;

    fn read(text: &str) -> Result<Vec<(String, String)>, String> {
        let entries = parse(text, &NodeName::new("eye", "/car", &[]).expect("valid"))?;
        Ok(entries.into_iter().map(|entry| (entry.name, entry.text)).collect())
    }

    #[test]
    fn an_entry_for_several_nodes_is_told_from_one_for_this_node() {
        let text = "/car/eye: {ros__parameters: {a: 1}}\n/**: {ros__parameters: {b: 1}}\n/car/*: {ros__parameters: {c: 1}}\n\
                    car: {eye: {ros__parameters: {d: 1}}}\n";
        let entries = parse(text, &NodeName::new("eye", "/car", &[]).expect("valid")).expect("readable");
        let by_name = entries.iter().map(|entry| (entry.name.as_str(), entry.by_name)).collect::<Vec<_>>();
        assert_eq!(by_name, [("a", true), ("b", false), ("c", false), ("d", true)]);
    }

    fn pairs(expected: &[(&str, &str)]) -> Vec<(String, String)> {
        expected.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect()
    }

    /// The rule of `rclcpp`: `/*` is one part of a name, `/**` any number.
    #[test]
    fn wildcards_mean_what_they_mean_in_ros() {
        let node_name = NodeName::new("eye", "/car", &[]).expect("valid");
        for (pattern, meant) in [
            ("/**", true),
            ("**", true),
            ("/car/eye", true),
            ("car/eye", true),
            ("/*/eye", true),
            ("/car/*", true),
            ("/car/**", true),
            ("/car/eye/**", true),
            ("/**/eye", true),
            ("/*/*", true),
            ("/*", false),
            ("/eye", false),
            ("eye", false),
            ("/car", false),
            ("/*/*/*", false),
            ("/**/ear", false),
            ("/ca*/eye", false),
        ] {
            assert_eq!(matches(pattern, &node_name), meant, "{pattern}");
        }
    }

    #[test]
    fn later_entries_come_later_whatever_they_are() {
        let text = "/car/eye:\n  ros__parameters: {angle: 2}\n/**:\n  ros__parameters: {angle: 3, beta: 1}\n\
                    /other:\n  ros__parameters: {angle: 4}\n";
        assert_eq!(read(text), Ok(pairs(&[("angle", "2"), ("angle", "3"), ("beta", "1")])));
    }

    #[test]
    fn names_and_parameters_nest() {
        let text = "car:\n  eye:\n    ros__parameters:\n      trust: {limit: 0.5, deep: {on: true}}\n      \
                    list: [a, 'b, c', 3]\n  ear:\n    ros__parameters: {list: [d]}\n";
        let expected = [("trust.limit", "0.5"), ("trust.deep.on", "true"), ("list", "[a, 'b, c', 3]")];
        assert_eq!(read(text), Ok(pairs(&expected)));
    }

    #[test]
    fn quotes_and_notation_stay() {
        let text = "/**:\n  ros__parameters: {a: 4.0, b: '8', c: \"x\", d: 1.0e+3}\n";
        assert_eq!(read(text), Ok(pairs(&[("a", "4.0"), ("b", "'8'"), ("c", "'x'"), ("d", "1.0e+3")])));
    }

    #[test]
    fn what_is_no_parameter_file_says_why() {
        for (text, why) in [
            ("[a]", "must be one mapping of node names"),
            ("", "must be one mapping of node names"),
            ("/eye: 3", "'/eye' has no mapping 'ros__parameters'"),
            ("/eye: {angle: 3}", "'/eye/angle' has no mapping"),
            ("/eye: {ros__parameters: 3}", "'ros__parameters' of '/eye' must be a mapping"),
            ("/eye: {ros__parameters: {a: [{b: 1}]}}", "parameter 'a' has no value"),
            ("a: [1", "line"),
        ] {
            let error = read(text).expect_err(text);
            assert!(error.contains(why), "{text}: {error}");
        }
    }

    #[test]
    fn what_is_written_is_what_ros2_param_dump_prints_and_reads_back() {
        let set = [
            ("wait_for", Value::Strings(vec!["a".into(), "b c".into()])),
            ("angle", Value::Double(4.0)),
            ("trust.limit", Value::Integer(3)),
            ("trust.deep.on", Value::Bool(true)),
            ("none", Value::Strings(Vec::new())),
            ("input", Value::String("no".into())),
        ];
        let values: Vec<_> = set.iter().map(|(name, v)| ((*name).to_owned(), to_ros(Some(v)))).collect();
        let text = write("/car/eye", &values);
        let expected = "/car/eye:\n  ros__parameters:\n    angle: 4.0\n    input: 'no'\n    none: []\n    trust:\n      \
                        deep:\n        on: true\n      limit: 3\n    wait_for:\n    - a\n    - 'b c'\n";
        assert_eq!(text, expected);
        let back = read(&text).expect("readable");
        assert_eq!(back.len(), set.len());
        for (name, value) in &set {
            let (_, text) = back.iter().find(|(other, _)| other == name).expect("is there");
            assert_eq!(value.parse_like(text).as_ref(), Some(value), "{name}");
        }
    }
}
