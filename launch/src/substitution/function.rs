//! The functions that a substitution can call, and their values.
//! Only the given surroundings are read, and the file system for packages; nothing is executed.

use std::collections::BTreeMap;
use std::path::Path;

use super::SubstitutionError;
use crate::package;

/// A substitution: its name, the fewest and the most arguments, and the value for so many of them.
pub(super) struct Function(&'static str, [usize; 2], fn(&[String], &Surroundings<'_>) -> Value);

type Value = Result<String, SubstitutionError>;

static KNOWN: [Function; 6] = [
    // `$(var name [default])`: a launch argument.
    Function("var", [1, 2], |given, around| variable(&given[0], given.get(1), around)),
    // `$(env NAME [default])`: an environment variable.
    Function("env", [1, 2], |given, _| environment_variable(&given[0], given.get(1))),
    // The folder of this launch file.
    Function("dirname", [0, 0], |_, around| Ok(folder_of(around.file))),
    // `<prefix>/share/<package>`.
    Function("find-pkg-share", [1, 1], |given, around| {
        let folder = package::share(&given[0], around.file);
        folder.map(|folder| folder.display().to_string()).map_err(SubstitutionError)
    }),
    Function("not", [1, 1], |given, _| Ok((!truth(&given[0])?).to_string())),
    // `$(if condition then [else])`.
    Function("if", [2, 3], |given, _| {
        Ok(given.get(if truth(&given[0])? { 1 } else { 2 }).cloned().unwrap_or_default())
    }),
];

impl Function {
    /// The function called `name`, or an error with the supported names.
    pub fn named(name: &str) -> Result<&'static Self, SubstitutionError> {
        KNOWN.iter().find(|known| known.0 == name).ok_or_else(|| {
            let known = KNOWN.iter().map(|known| known.0).collect::<Vec<_>>().join(", ");
            SubstitutionError(format!("$({name}) is not supported, supported are {known}"))
        })
    }

    pub fn check_count(&self, given: usize) -> Result<(), SubstitutionError> {
        let Self(name, [fewest, most], _) = *self;
        let takes = match (fewest, most) {
            _ if (fewest..=most).contains(&given) => return Ok(()),
            (0, 0) => "no argument".to_owned(),
            (1, 1) => "1 argument".to_owned(),
            (a, b) if a == b => format!("{a} arguments"),
            (a, b) => format!("{a} or {b} arguments"),
        };
        Err(SubstitutionError(format!("$({name}) takes {takes}, not {given}")))
    }

    pub fn value(&self, arguments: &[String], around: &Surroundings<'_>) -> Value {
        (self.2)(arguments, around)
    }
}

/// The values that a text can refer to.
#[derive(Clone, Copy, Debug)]
pub struct Surroundings<'a> {
    /// The launch file in which the text stands.
    pub file: &'a Path,
    /// The values of the launch arguments.
    pub variables: &'a BTreeMap<String, String>,
}

fn environment_variable(name: &str, default: Option<&String>) -> Value {
    std::env::var(name).ok().or_else(|| default.cloned()).ok_or_else(|| {
        SubstitutionError(format!(
            "environment variable {name} is not set, $(env {name} DEFAULT) gives it a default"
        ))
    })
}

fn folder_of(file: &Path) -> String {
    let folder = file.parent().filter(|p| !p.as_os_str().is_empty());
    folder.unwrap_or(Path::new(".")).display().to_string()
}

fn variable(name: &str, default: Option<&String>, around: &Surroundings<'_>) -> Value {
    around.variables.get(name).or(default).cloned().ok_or_else(|| {
        let known: Vec<&str> = around.variables.keys().map(String::as_str).collect();
        let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
        SubstitutionError(format!("undefined variable '{name}', defined here are {known}"))
    })
}

/// ROS 2's rule for conditions: `true` or `1`, `false` or `0`, in any case; anything else is an error.
pub(crate) fn truth(text: &str) -> Result<bool, SubstitutionError> {
    match text.trim().to_ascii_lowercase().as_str() {
        "true" | "1" => Ok(true),
        "false" | "0" => Ok(false),
        _ => Err(SubstitutionError(format!("'{text}' is not a condition; use true, false, 1 or 0"))),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Piece, pieces};
    use super::*;

    fn value(text: &str) -> Result<String, String> {
        let pair = |(k, v): (&str, &str)| (k.to_owned(), v.to_owned());
        let variables = [("x", "4.0"), ("name", "x"), ("on", "True")].map(pair).into();
        let file = Path::new("/opt/pkg/launch/a.launch.yaml");
        let around = Surroundings { file, variables: &variables };
        let pieces = pieces(text, Some(&around)).map_err(|e| e.to_string())?;
        Ok(pieces.iter().map(Piece::as_str).collect())
    }

    #[test]
    fn values() {
        for (text, expected) in [
            ("$(var x)", "4.0"),
            ("$(var $(var name))", "4.0"),
            ("$(var none 'a b')", "a b"),
            ("$(env NOPE d)", "d"),
            ("$(dirname)", "/opt/pkg/launch"),
            ("$(not $(var on))", "false"),
            ("$(if $(var on) yes no)$(if 0 yes)", "yes"),
        ] {
            assert_eq!(value(text).as_deref(), Ok(expected), "{text}");
        }
    }

    #[test]
    fn what_has_no_value_says_what_has() {
        for (text, message) in [
            ("$(var y)", "undefined variable 'y', defined here are name, on, x"),
            ("$(env NOPE)", "environment variable NOPE is not set"),
            ("$(not maybe)", "'maybe' is not a condition"),
            (
                "$(find-pkg-share no_such)",
                "package 'no_such' is not found, looked in AMENT_PREFIX_PATH, which is empty",
            ),
        ] {
            let error = value(text).expect_err(text);
            assert!(error.contains(message), "{error}");
        }
    }
}
