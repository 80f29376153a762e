//! `--ros-args`: what `ros2 run` and `ros2 launch` put behind an executable's
//! own arguments. Pure, except that named parameter files are read.

use std::path::PathBuf;

use saphyr::{LoadableYamlNode, Scalar, Yaml};

use crate::name::{NameError, Place};

/// The ROS part of a command line.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RosArgs {
    /// `-r __node:=name`
    pub name: Option<String>,
    /// `-r __ns:=/namespace`
    pub namespace: Option<String>,
    /// `-r from:=to`
    pub remaps: Vec<(String, String)>,
    /// `-p name:=value` and parameter files, in order; later ones win.
    pub parameters: Vec<Setting>,
    /// `--log-level level`, for the whole process.
    pub log_level: Option<String>,
    /// `--disable-rosout-logs`, `--enable-rosout-logs`: whether `/rosout` is published.
    pub rosout: Switch,
    /// `--disable-stdout-logs`, `--enable-stdout-logs`: whether log lines are shown.
    pub stdout: Switch,
}

/// Whether something is done; the last one on the command line wins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Switch {
    /// It is.
    #[default]
    On,
    /// It is not.
    Off,
}

/// Parameters as the command line gives them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Setting {
    /// One parameter, for the node of this name or for any.
    Value {
        /// Name of the node, if the rule names one.
        node: Option<String>,
        /// Name of the parameter.
        name: String,
        /// Its value as text.
        value: String,
    },
    /// A parameter file.
    File(PathBuf),
}

/// Why a command line or a parameter file cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ArgsError {
    /// An argument is not understood.
    #[error("--ros-args: '{argument}' {why}")]
    Argument {
        /// As given.
        argument: String,
        /// What is possible.
        why: &'static str,
    },
    /// A parameter file is not there or not of the right shape.
    #[error("parameter file {path}: {why}")]
    File {
        /// As given.
        path: String,
        /// What is wrong.
        why: String,
    },
}

const RULE: &str = "is not a rule 'from:=to'";

impl RosArgs {
    /// Reads everything behind `--ros-args` up to `--`. Returns also what stands
    /// outside of it.
    ///
    /// # Errors
    /// [`ArgsError::Argument`] for what ROS 2 does not know.
    pub fn parse(arguments: &[String]) -> Result<(Self, Vec<String>), ArgsError> {
        let mut parsed = Self::default();
        let mut own = Vec::new();
        let mut ros = false;
        let mut rest = arguments.iter();
        while let Some(argument) = rest.next() {
            match argument.as_str() {
                "--ros-args" => ros = true,
                "--" if ros => ros = false,
                _ if !ros => own.push(argument.clone()),
                flag => parsed.flag(flag, &mut rest)?,
            }
        }
        Ok((parsed, own))
    }

    fn flag<'a>(&mut self, flag: &str, rest: &mut impl Iterator<Item = &'a String>) -> Result<(), ArgsError> {
        match flag {
            "--enable-rosout-logs" => self.rosout = Switch::On,
            "--disable-rosout-logs" => self.rosout = Switch::Off,
            "--enable-stdout-logs" => self.stdout = Switch::On,
            "--disable-stdout-logs" => self.stdout = Switch::Off,
            // Of rcl's log files, which are not written here.
            "--enable-external-lib-logs" | "--disable-external-lib-logs" => {}
            _ => return self.flag_with_value(flag, rest),
        }
        Ok(())
    }

    fn flag_with_value<'a>(
        &mut self,
        flag: &str,
        rest: &mut impl Iterator<Item = &'a String>,
    ) -> Result<(), ArgsError> {
        let wrong = |why| ArgsError::Argument { argument: flag.to_owned(), why };
        let value = rest.next().ok_or(wrong("needs a value or is unknown"))?;
        match flag {
            "-r" | "--remap" => self.remap(value),
            "-p" | "--param" => self.parameter(value),
            "--params-file" => {
                self.parameters.push(Setting::File(value.into()));
                Ok(())
            }
            "--log-level" => {
                self.log_level = Some(value.clone());
                Ok(())
            }
            "-e" | "--enclave" | "--log-config-file" | "--log-file-name" => Ok(()),
            _ => Err(wrong("is unknown; -r, -p, --params-file, --log-level, --enclave are possible")),
        }
    }

    fn remap(&mut self, rule: &str) -> Result<(), ArgsError> {
        let (from, to) = split_rule(rule)?;
        let (_, from) = split_node(from);
        match from {
            "__node" | "__name" => self.name = Some(to.to_owned()),
            "__ns" => self.namespace = Some(to.to_owned()),
            _ => self.remaps.push((strip_scheme(from).to_owned(), strip_scheme(to).to_owned())),
        }
        Ok(())
    }

    fn parameter(&mut self, rule: &str) -> Result<(), ArgsError> {
        let (name, value) = split_rule(rule)?;
        let (node, name) = split_node(name);
        self.parameters.push(Setting::Value {
            node: node.map(str::to_owned),
            name: name.to_owned(),
            value: value.to_owned(),
        });
        Ok(())
    }

    /// Where the node lies, `default_name` unless the arguments say otherwise.
    ///
    /// # Errors
    /// [`NameError`] when a name is none.
    pub fn place(&self, default_name: &str) -> Result<Place, NameError> {
        let name = self.name.as_deref().unwrap_or(default_name);
        Place::new(name, self.namespace.as_deref().unwrap_or("/"), &self.remaps)
    }

    /// Parameters for the node at `place` as (name, text), in order.
    ///
    /// # Errors
    /// [`ArgsError::File`] when a parameter file cannot be read.
    pub fn parameters_for(&self, place: &Place) -> Result<Vec<(String, String)>, ArgsError> {
        let mut found = Vec::new();
        for setting in &self.parameters {
            match setting {
                Setting::Value { node, name, value } => {
                    if node.as_ref().is_none_or(|node| node.trim_start_matches('/') == place.name) {
                        found.push((name.clone(), value.clone()));
                    }
                }
                Setting::File(path) => found.extend(read_file(path, place)?),
            }
        }
        Ok(found)
    }
}

fn split_rule(rule: &str) -> Result<(&str, &str), ArgsError> {
    rule.split_once(":=").ok_or_else(|| ArgsError::Argument { argument: rule.to_owned(), why: RULE })
}

/// `node:name` names a node, `rostopic://name` does not.
fn split_node(name: &str) -> (Option<&str>, &str) {
    match name.split_once(':') {
        Some((node, rest)) if !rest.starts_with("//") => (Some(node), rest),
        _ => (None, name),
    }
}

fn strip_scheme(name: &str) -> &str {
    name.strip_prefix("rostopic://").or_else(|| name.strip_prefix("rosservice://")).unwrap_or(name)
}

fn read_file(path: &std::path::Path, place: &Place) -> Result<Vec<(String, String)>, ArgsError> {
    let wrong = |why: String| ArgsError::File { path: path.display().to_string(), why };
    let text = std::fs::read_to_string(path).map_err(|why| wrong(why.to_string()))?;
    let documents = Yaml::load_from_str(&text).map_err(|why| wrong(why.to_string()))?;
    let Some(nodes) = documents.first().and_then(Yaml::as_mapping) else {
        return Err(wrong("must be a mapping of node names".into()));
    };
    let mut found = Vec::new();
    for (pattern, body) in nodes {
        let pattern = pattern.as_str().unwrap_or_default();
        if !matches_node(pattern, place) {
            continue;
        }
        let parameters = body
            .as_mapping_get("ros__parameters")
            .and_then(Yaml::as_mapping)
            .ok_or_else(|| wrong(format!("'{pattern}' has no mapping 'ros__parameters'")))?;
        for (name, value) in parameters {
            flatten(name.as_str().unwrap_or_default(), value, &mut found);
        }
    }
    Ok(found)
}

/// Whether a key of a parameter file, with `*` for one part and `**` for any,
/// means the node at `place`.
fn matches_node(pattern: &str, place: &Place) -> bool {
    let full = place.fully_qualified();
    let name: Vec<&str> = full.split('/').filter(|p| !p.is_empty()).collect();
    let pattern: Vec<&str> = pattern.split('/').filter(|p| !p.is_empty()).collect();
    fn matches(pattern: &[&str], name: &[&str]) -> bool {
        match (pattern, name) {
            ([], []) => true,
            (["**", rest @ ..], _) => (0..=name.len()).any(|skip| matches(rest, &name[skip..])),
            (["*", rest @ ..], [_, name @ ..]) => matches(rest, name),
            ([part, rest @ ..], [first, name @ ..]) => part == first && matches(rest, name),
            _ => false,
        }
    }
    matches(&pattern, &name)
}

fn flatten(name: &str, value: &Yaml<'_>, found: &mut Vec<(String, String)>) {
    if let Some(mapping) = value.as_mapping() {
        for (key, value) in mapping {
            flatten(&format!("{name}.{}", key.as_str().unwrap_or_default()), value, found);
        }
        return;
    }
    let text = match value.as_sequence() {
        Some(list) => format!("[{}]", list.iter().map(scalar).collect::<Vec<_>>().join(", ")),
        None => scalar(value),
    };
    found.push((name.to_owned(), text));
}

fn scalar(value: &Yaml<'_>) -> String {
    match value {
        Yaml::Value(Scalar::String(text)) => text.to_string(),
        Yaml::Value(Scalar::Boolean(v)) => v.to_string(),
        Yaml::Value(Scalar::Integer(v)) => v.to_string(),
        Yaml::Value(Scalar::FloatingPoint(v)) => v.to_string(),
        Yaml::Representation(text, ..) => text.to_string(),
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Result<(RosArgs, Vec<String>), ArgsError> {
        RosArgs::parse(&line.split_whitespace().map(str::to_owned).collect::<Vec<_>>())
    }

    #[test]
    fn reads_what_ros2_launch_writes() {
        let line = "own --ros-args -r __node:=eye -r __ns:=/car -p alpha:=2.5 -p other:alpha:=9 -r modulo:=/raw \
                    --log-level info --enclave /e --disable-rosout-logs -- more";
        let (args, own) = parse(line).expect("a valid line");
        assert_eq!(own, ["own", "more"]);
        let place = args.place("modulo_camera").expect("valid names");
        assert_eq!(place.fully_qualified(), "/car/eye");
        assert_eq!(place.resolve("modulo").as_deref(), Ok("/raw"));
        assert_eq!(args.parameters_for(&place), Ok(vec![("alpha".into(), "2.5".into())]));
        assert_eq!(args.log_level.as_deref(), Some("info"));
        assert_eq!((args.rosout, args.stdout), (Switch::Off, Switch::On));
        let (args, _) = parse("--ros-args --disable-rosout-logs --enable-rosout-logs --disable-stdout-logs")
            .expect("a valid line");
        assert_eq!((args.rosout, args.stdout), (Switch::On, Switch::Off));
    }

    #[test]
    fn refuses_what_it_does_not_know() {
        for (line, named) in [
            ("--ros-args --frobnicate x", "--frobnicate"),
            ("--ros-args -p alpha=2", "alpha=2"),
            ("--ros-args -r", "-r"),
        ] {
            let message = parse(line).expect_err("must be refused").to_string();
            assert!(message.contains(named), "{message}");
        }
    }

    #[test]
    fn parameter_files_have_wildcards_and_nesting() {
        let file = std::env::temp_dir().join(format!("modulo-ros-args-{}.yaml", std::process::id()));
        let text = "/**:\n  ros__parameters:\n    alpha: 2\n    list: [a, b]\n/car/*:\n  ros__parameters:\n    \
                    trust: {limit: 0.5}\n/other/eye:\n  ros__parameters: {alpha: 9}\n";
        std::fs::write(&file, text).expect("temp dir is writable");
        let place = Place::new("eye", "/car", &[]).expect("valid");
        let (args, _) = parse(&format!("--ros-args --params-file {}", file.display())).expect("valid");
        let found = args.parameters_for(&place);
        std::fs::remove_file(&file).expect("was written");
        let expected = [("alpha", "2"), ("list", "[a, b]"), ("trust.limit", "0.5")];
        assert_eq!(found, Ok(expected.map(|(n, v)| (n.to_owned(), v.to_owned())).to_vec()));
    }

    #[test]
    fn a_missing_parameter_file_is_named() {
        let (args, _) = parse("--ros-args --params-file /no/such.yaml").expect("valid");
        let place = args.place("n").expect("valid");
        assert!(args.parameters_for(&place).expect_err("is missing").to_string().contains("/no/such.yaml"));
    }
}
