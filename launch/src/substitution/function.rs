//! The functions that a substitution can call, their values, and the functions of ROS 2 that are refused, with the reason.
//! Only the given surroundings are read, and the file system for packages; nothing is executed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::{Part, SubstitutionError, Template};
use crate::listed;
use crate::package;

/// A substitution that can be evaluated: its name, the fewest and the most arguments, and the value for so many of them.
#[derive(Debug)]
pub struct Function(&'static str, [usize; 2], fn(&[String], &Surroundings<'_>) -> Value);

type Value = Result<String, SubstitutionError>;

impl PartialEq for Function {
    fn eq(&self, other: &Self) -> bool {
        self.0 == other.0
    }
}

impl Eq for Function {}

static KNOWN: [Function; 12] = [
    // `$(var name [default])`: a launch argument or a `let`.
    Function("var", [1, 2], |given, around| variable(&given[0], given.get(1), around)),
    // `$(env NAME [default])`: an environment variable.
    Function("env", [1, 2], |given, around| environment_variable(&given[0], given.get(1), around)),
    // The folder and the path of this launch file.
    Function("dirname", [0, 0], |_, around| Ok(folder_of(around.file))),
    Function("filename", [0, 0], |_, around| Ok(around.file.display().to_string())),
    // `<prefix>/share/<package>`, and the prefix.
    Function("find-pkg-share", [1, 1], |given, around| {
        found(package::share(&given[0], around.file, around.environment))
    }),
    Function("find-pkg-prefix", [1, 1], |given, around| {
        found(package::prefix(&given[0], around.file, around.environment))
    }),
    Function("not", [1, 1], |given, _| Ok((!truth(&given[0])?).to_string())),
    // Both sides are evaluated: one that is not a condition is an error, whatever the other says.
    Function("and", [2, 2], |given, _| Ok((truth(&given[0])? & truth(&given[1])?).to_string())),
    Function("or", [2, 2], |given, _| Ok((truth(&given[0])? | truth(&given[1])?).to_string())),
    // As bools or numbers when both are, else as text.
    Function("equals", [2, 2], |given, _| Ok(equal(&given[0], &given[1]).to_string())),
    Function("not-equals", [2, 2], |given, _| Ok((!equal(&given[0], &given[1])).to_string())),
    // `$(if condition then [else])`.
    Function("if", [2, 3], |given, _| {
        Ok(given.get(if truth(&given[0])? { 1 } else { 2 }).cloned().unwrap_or_default())
    }),
];

/// The functions of ROS 2 that are not supported, each with the reason.
const REFUSED: [(&str, &str); 11] = [
    ("eval", "it runs Python; compute the value outside or use $(if), $(equals), $(and), $(or), $(not)"),
    ("command", "it runs a shell; pass the value as a launch argument"),
    ("anon", "names must be the same on every run; give the name as a launch argument"),
    ("param", "it reads a parameter of the launch; use 'let' and $(var)"),
    ("file-content", "it pastes a file into text; pass the path and let the node read it"),
    ("exec-in-pkg", "use the action 'node' with pkg and exec"),
    ("find-exec", "the action 'executable' looks a program up in PATH itself"),
    ("log_dir", "output is shown on the terminal and no log folder is kept"),
    ("any", "use nested $(or a b)"),
    ("all", "use nested $(and a b)"),
    ("launch_log_dir", "output is shown on the terminal and no log folder is kept"),
];

impl Function {
    /// The function called `name`.
    ///
    /// # Errors
    /// [`SubstitutionError`] with the known names, or with the reason why a known one of ROS 2 is not supported.
    pub fn named(name: &str) -> Result<&'static Self, SubstitutionError> {
        if let Some(function) = KNOWN.iter().find(|known| known.0 == name) {
            return Ok(function);
        }
        Err(SubstitutionError::Invalid(match REFUSED.iter().find(|refused| refused.0 == name) {
            Some((_, why)) => format!("$({name}) is not supported: {why}"),
            None => {
                let known = listed(KNOWN.iter().map(|known| known.0), "");
                format!("unknown substitution $({name}), known are {known}")
            }
        }))
    }

    pub(super) fn check_count(&self, given: usize) -> Result<(), SubstitutionError> {
        let Self(name, [fewest, most], _) = *self;
        let takes = match (fewest, most) {
            _ if (fewest..=most).contains(&given) => return Ok(()),
            (0, 0) => "no argument".to_owned(),
            (1, 1) => "1 argument".to_owned(),
            (a, b) if a == b => format!("{a} arguments"),
            (a, b) => format!("{a} or {b} arguments"),
        };
        Err(SubstitutionError::Invalid(format!("$({name}) takes {takes}, not {given}")))
    }
}

/// The values that a template can refer to.
#[derive(Clone, Copy, Debug)]
pub struct Surroundings<'a> {
    /// The launch file in which the template stands.
    pub file: &'a Path,
    /// Launch arguments and `let`s.
    pub variables: &'a BTreeMap<String, String>,
    /// The variables of `set_env`, which stand before those of the launcher's environment.
    pub environment: &'a BTreeMap<String, String>,
}

impl Template {
    /// The text with every substitution replaced by its value.
    pub fn evaluate(&self, around: &Surroundings<'_>) -> Value {
        self.parts.iter().map(|part| part.evaluate(around)).collect()
    }
}

impl Part {
    /// The value of this piece.
    pub fn evaluate(&self, around: &Surroundings<'_>) -> Value {
        match self {
            Self::Text(text) => Ok(text.clone()),
            Self::Call(function, arguments) => {
                let values: Result<Vec<String>, _> = arguments.iter().map(|a| a.evaluate(around)).collect();
                (function.2)(&values?, around)
            }
        }
    }
}

fn found(folder: Result<PathBuf, String>) -> Value {
    folder.map(|folder| folder.display().to_string()).map_err(SubstitutionError::Invalid)
}

fn environment_variable(name: &str, default: Option<&String>, around: &Surroundings<'_>) -> Value {
    package::variable(around.environment, name).or_else(|| default.cloned()).ok_or_else(|| {
        SubstitutionError::Invalid(format!(
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
        let known = listed(around.variables.keys(), "none");
        SubstitutionError::Undefined(name.to_owned(), known)
    })
}

/// ROS 2's rule for conditions: `true` or `1`, `false` or `0`, in any case; anything else is an error.
pub(crate) fn truth(text: &str) -> Result<bool, SubstitutionError> {
    match text.trim().to_ascii_lowercase().as_str() {
        "true" | "1" => Ok(true),
        "false" | "0" => Ok(false),
        _ => Err(SubstitutionError::Invalid(format!("'{text}' is not a condition; use true, false, 1 or 0"))),
    }
}

/// ROS 2's `$(equals)`: bools as bools, numbers within 1e-9 of the larger, else text.
fn equal(left: &str, right: &str) -> bool {
    // Conditions come before numbers, so that `true` equals `1`.
    if let (Ok(left), Ok(right)) = (truth(left), truth(right)) {
        return left == right;
    }
    match (left.trim().parse::<f64>(), right.trim().parse::<f64>()) {
        (Ok(l), Ok(r)) => {
            // The tolerance is the default of `math.isclose` of Python. The first comparison makes equal
            // infinities equal, whose difference is not a number.
            l == r || (l - r).abs() <= 1e-9 * l.abs().max(r.abs()) && l.is_finite() && r.is_finite()
        }
        _ => left == right,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str) -> Result<String, String> {
        let pair = |(k, v): (&str, &str)| (k.to_owned(), v.to_owned());
        let variables = [("x", "4.0"), ("name", "x"), ("on", "True")].map(pair).into();
        let environment = [("HOME", "/home/u")].map(pair).into();
        let file = Path::new("/opt/pkg/launch/a.launch.yaml");
        let around = Surroundings { file, variables: &variables, environment: &environment };
        Template::parse(text).and_then(|t| t.evaluate(&around)).map_err(|e| e.to_string())
    }

    #[test]
    fn values() {
        for (text, expected) in [
            ("$(var x)", "4.0"),
            ("$(var $(var name))", "4.0"),
            ("$(var none 'a b')", "a b"),
            ("$(env HOME)/$(env NOPE d)", "/home/u/d"),
            ("$(dirname)|$(filename)", "/opt/pkg/launch|/opt/pkg/launch/a.launch.yaml"),
            ("$(not $(var on))", "false"),
            ("$(and 1 $(var on))$(or 0 false)", "truefalse"),
            ("$(equals $(var x) 4)$(equals true 1)$(equals a b)", "truetruefalse"),
            ("$(not-equals nan nan)$(equals inf inf)", "truetrue"),
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
