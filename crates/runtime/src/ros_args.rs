//! `--ros-args`: the arguments that `ros2 run` and `ros2 launch` append to those of an executable. This is pure code.

use std::path::PathBuf;

use crate::name::{NameError, NodeName};

/// The ROS part of a command line.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RosArgs {
    /// `-r from:=to` in order; the first that fits is used.
    pub remaps: Vec<Rule>,
    /// `-p name:=value` and parameter files, in order; later ones win.
    pub parameters: Vec<Setting>,
    /// `--log-level level` and `--log-level logger:=level` in order, as the logger, or `None` for all of them, and its level in
    /// `tracing` (`debug`, `info`, `warn` or `error`); later ones win.
    pub log_levels: Vec<(Option<String>, &'static str)>,
    /// Whether `--disable-rosout-logs` was given, and no `--enable-rosout-logs` after it.
    pub no_rosout_logs: bool,
    /// Whether `--disable-stdout-logs` was given, and no `--enable-stdout-logs` after it.
    pub no_stdout_logs: bool,
}

/// A rule `[node:]name:=value`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rule {
    /// Name of the node it is for, if the rule names one.
    pub node: Option<String>,
    /// `__node`, `__ns`, or the name of a topic, a service or a parameter.
    pub name: String,
    /// The new name, or the value of the parameter as text.
    pub value: String,
}

/// Parameters as the command line gives them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Setting {
    /// One parameter.
    Value(Rule),
    /// The path of a parameter file.
    File(PathBuf),
}

/// Error: a command line or a parameter file cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ArgsError {
    /// An argument is not understood.
    #[error("--ros-args: '{0}' {1}")]
    Argument(String, &'static str),
    /// A secure enclave is requested.
    #[error(
        "--enclave {0}: the suite has no secure enclaves of ROS 2 (SROS 2); leave the option out, and encrypt the connections \
         between machines by their routers (docs/how-to/two-machines.md)"
    )]
    Enclave(String),
    /// The environment demands secure enclaves.
    #[error(
        "ROS_SECURITY_ENABLE=true with ROS_SECURITY_STRATEGY=Enforce demands secure enclaves of ROS 2 (SROS 2), which the suite \
         does not have; unset one of the two, and encrypt the connections between machines by their routers (docs/how-to/two-machines.md)"
    )]
    Security,
    /// A parameter file is not there or not of the right shape.
    #[error("parameter file {0}: {1}")]
    File(String, String),
}

const RULE: &str = "is not a rule 'from:=to'";
const LEVEL: &str = "is not a log level; debug, info, warn, error, fatal and LOGGER:=LEVEL are possible";
const UNKNOWN: &str = "is unknown; -r, -p, --params-file, --log-level, --log-config-file, --log-file-name and --enable|disable-rosout|stdout|external-lib-logs are possible";

impl RosArgs {
    /// Reads the arguments from `--ros-args` to `--`. Also returns the arguments outside of them.
    ///
    /// # Errors
    /// [`ArgsError::Argument`] for an argument that ROS 2 does not know.
    pub fn parse(arguments: &[String]) -> Result<(Self, Vec<String>), ArgsError> {
        let mut parsed = Self::default();
        let mut own = Vec::new();
        let mut ros = false;
        let mut rest = arguments.iter();
        while let Some(argument) = rest.next() {
            match argument.as_str() {
                "--ros-args" => ros = true,
                // A line may have several blocks of ROS arguments, as in `rcl`.
                "--" if ros => ros = false,
                _ if !ros => own.push(argument.clone()),
                flag => parsed.flag(flag, &mut rest)?,
            }
        }
        Ok((parsed, own))
    }

    fn flag<'a>(&mut self, flag: &str, rest: &mut impl Iterator<Item = &'a String>) -> Result<(), ArgsError> {
        let wrong = |why| ArgsError::Argument(flag.to_owned(), why);
        let mut value = || rest.next().ok_or(wrong("needs a value"));
        match flag {
            "--enable-rosout-logs" => self.no_rosout_logs = false,
            "--disable-rosout-logs" => self.no_rosout_logs = true,
            "--enable-stdout-logs" => self.no_stdout_logs = false,
            "--disable-stdout-logs" => self.no_stdout_logs = true,
            // There is no such library here, and no log file.
            "--enable-external-lib-logs" | "--disable-external-lib-logs" => {}
            "-r" | "--remap" => self.remap(value()?)?,
            "-p" | "--param" => self.parameters.push(Setting::Value(Rule::parse(value()?)?)),
            "--params-file" => self.parameters.push(Setting::File(value()?.into())),
            "--log-level" => self.log_level(value()?)?,
            "-e" | "--enclave" => return Err(ArgsError::Enclave(value()?.clone())),
            "--log-config-file" | "--log-file-name" => drop(value()?),
            _ => return Err(wrong(UNKNOWN)),
        }
        Ok(())
    }

    fn remap(&mut self, rule: &str) -> Result<(), ArgsError> {
        let Rule { node, name, value } = Rule::parse(rule)?;
        // `rcl` reads both spellings.
        let name = if name == "__name" { "__node" } else { strip_scheme(&name) }.to_owned();
        self.remaps.push(Rule { node, name, value: strip_scheme(&value).to_owned() });
        Ok(())
    }

    fn log_level(&mut self, rule: &str) -> Result<(), ArgsError> {
        let (logger, level) = match rule.split_once(":=") {
            Some((logger, level)) => (Some(logger.to_owned()), level),
            None => (None, rule),
        };
        let level = match level.to_ascii_lowercase().as_str() {
            "debug" => "debug",
            "info" => "info",
            "warn" => "warn",
            // `tracing` has no level above error.
            "error" | "fatal" => "error",
            _ => return Err(ArgsError::Argument(rule.to_owned(), LEVEL)),
        };
        self.log_levels.push((logger, level));
        Ok(())
    }

    /// Returns the name of the node, `default_name` unless a rule changes it. As in `rcl`, a rule for a node means its
    /// new name, except for the rule that gives the name.
    ///
    /// # Errors
    /// [`NameError`] when a name is not valid.
    pub fn node_name(&self, default_name: &str) -> Result<NodeName, NameError> {
        let name = self.first("__node", default_name).unwrap_or(default_name);
        let remaps: Vec<_> = self
            .remaps
            .iter()
            .filter(|rule| rule.is_for(name) && !rule.name.starts_with("__"))
            .map(|rule| (rule.name.clone(), rule.value.clone()))
            .collect();
        NodeName::new(name, self.first("__ns", name).unwrap_or("/"), &remaps)
    }

    /// Returns the level of the logger `name`; a node's has the node's name.
    pub fn log_level_of(&self, name: &str) -> Option<&'static str> {
        // The last rule that fits wins, be it for all loggers or for this one.
        let mut levels = self.log_levels.iter();
        let meant = levels.rfind(|(logger, _)| logger.as_ref().is_none_or(|logger| logger == name));
        meant.map(|(_, level)| *level)
    }

    fn first(&self, name: &str, node: &str) -> Option<&str> {
        self.remaps.iter().find(|rule| rule.name == name && rule.is_for(node)).map(|rule| rule.value.as_str())
    }
}

/// Checks what the environment variables `ROS_SECURITY_ENABLE` and `ROS_SECURITY_STRATEGY` demand; returns a warning where
/// they ask for security without demanding it. The values are those of `rcl`.
///
/// # Errors
/// [`ArgsError::Security`] when security is demanded: a node that went on unsecured would deceive its user.
pub fn check_security(
    enable: Option<&str>,
    strategy: Option<&str>,
) -> Result<Option<&'static str>, ArgsError> {
    match (enable, strategy) {
        (Some("true"), Some("Enforce")) => Err(ArgsError::Security),
        (Some("true"), _) => Ok(Some(
            "ROS_SECURITY_ENABLE=true: the suite has no secure enclaves of ROS 2; it goes on without security",
        )),
        _ => Ok(None),
    }
}

impl Rule {
    fn parse(rule: &str) -> Result<Self, ArgsError> {
        let wrong = || ArgsError::Argument(rule.to_owned(), RULE);
        let (name, value) = rule.split_once(":=").ok_or_else(wrong)?;
        let (node, name) = match name.split_once(':') {
            // `rostopic://name` names no node.
            Some((node, rest)) if !rest.starts_with("//") => (Some(node.to_owned()), rest),
            _ => (None, name),
        };
        Ok(Self { node, name: name.to_owned(), value: value.to_owned() })
    }

    /// Returns whether the rule is for the node of this name.
    pub fn is_for(&self, name: &str) -> bool {
        self.node.as_ref().is_none_or(|node| node.trim_start_matches('/') == name)
    }
}

fn strip_scheme(name: &str) -> &str {
    name.strip_prefix("rostopic://").or_else(|| name.strip_prefix("rosservice://")).unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Result<(RosArgs, Vec<String>), ArgsError> {
        RosArgs::parse(&line.split_whitespace().map(str::to_owned).collect::<Vec<_>>())
    }

    #[test]
    fn reads_what_ros2_launch_writes() {
        let line = "own --ros-args -r __node:=eye -r __ns:=/car -p angle:=2.5 -p other:angle:=9 -r modulo:=/raw \
                    --log-level info --disable-rosout-logs -- more";
        let (args, own) = parse(line).expect("a valid line");
        assert_eq!(own, ["own", "more"]);
        let node_name = args.node_name("modulo_camera").expect("valid names");
        assert_eq!(node_name.fully_qualified(), "/car/eye");
        assert_eq!(node_name.resolve("modulo").as_deref(), Ok("/raw"));
        assert_eq!(args.parameters_for(&node_name), Ok(vec![("angle".into(), "2.5".into())]));
        assert_eq!(args.log_levels, [(None, "info")]);
    }

    #[test]
    fn a_rule_for_a_node_means_that_node_alone() {
        let line = "--ros-args -r camera:__node:=eye -r other:__ns:=/no -r eye:__ns:=/car -r eye:a:=/b \
                    -r other:c:=/d -r c:=/e -r c:=/f -r rostopic://g:=rostopic:///h";
        let (args, _) = parse(line).expect("a valid line");
        let node_name = args.node_name("camera").expect("valid names");
        assert_eq!(node_name.fully_qualified(), "/car/eye");
        for (from, to) in [("a", "/b"), ("c", "/e"), ("g", "/h"), ("x", "/car/x")] {
            assert_eq!(node_name.resolve(from).as_deref(), Ok(to), "{from}");
        }
        assert_eq!(args.node_name("unwrap").expect("valid").fully_qualified(), "/unwrap");
    }

    #[test]
    fn log_levels_are_for_all_or_for_one_logger() {
        let line = "--ros-args --log-level DEBUG --log-level rcl:=fatal --disable-stdout-logs --disable-rosout-logs \
                    --enable-rosout-logs --log-config-file f --disable-external-lib-logs";
        let (args, _) = parse(line).expect("a valid line");
        assert_eq!((args.log_level_of("eye"), args.log_level_of("rcl")), (Some("debug"), Some("error")));
        assert_eq!((args.no_rosout_logs, args.no_stdout_logs), (false, true));
    }

    #[test]
    fn refuses_what_it_does_not_know() {
        for (line, named) in [
            ("--ros-args --frobnicate", "--frobnicate' is unknown; -r, -p"),
            ("--ros-args -p angle=2", "angle=2"),
            ("--ros-args -r", "-r' needs a value"),
            ("--ros-args --log-level loud", "loud' is not a log level"),
            ("--ros-args angle:=2", "angle:=2' is unknown"),
            ("--ros-args --enclave /e", "--enclave /e: the suite has no secure enclaves"),
        ] {
            let message = parse(line).expect_err("must be refused").to_string();
            assert!(message.contains(named), "{message}");
        }
    }

    #[test]
    fn security_is_refused_where_it_is_demanded() {
        assert_eq!(check_security(Some("true"), Some("Enforce")), Err(ArgsError::Security));
        for strategy in [None, Some("Permissive")] {
            assert!(check_security(Some("true"), strategy).is_ok_and(|printed| printed.is_some()));
        }
        for (enable, strategy) in [(None, Some("Enforce")), (Some("false"), Some("Enforce")), (None, None)] {
            assert_eq!(check_security(enable, strategy), Ok(None));
        }
    }

    #[test]
    fn later_settings_come_later() {
        let file = std::env::temp_dir().join(format!("modulo-ros-args-{}.yaml", std::process::id()));
        std::fs::write(&file, "/**:\n  ros__parameters: {angle: 2}\n").expect("temp dir is writable");
        let line =
            format!("--ros-args -p angle:=1 --params-file {} -p angle:=3 -p n:angle:=4", file.display());
        let found = parse(&line).map(|(args, _)| args.parameters_for(&args.node_name("n").expect("valid")));
        std::fs::remove_file(&file).expect("was written");
        let values: Vec<_> = found.expect("valid").expect("readable").into_iter().map(|(_, v)| v).collect();
        assert_eq!(values, ["1", "2", "3", "4"]);
    }
}
