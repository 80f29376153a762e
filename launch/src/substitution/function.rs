//! The substitutions there are, and those of ROS 2 that are refused, with the
//! reason. Nothing is evaluated here.

use super::SubstitutionError;
use crate::error::listed;

/// A substitution that can be evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    /// `$(var name [default])`: a launch argument or a `let`.
    Var,
    /// `$(env NAME [default])`: an environment variable.
    Env,
    /// `$(dirname)`: the folder of this launch file.
    Dirname,
    /// `$(filename)`: the path of this launch file.
    Filename,
    /// `$(find-pkg-share package)`: `<prefix>/share/<package>`.
    FindPkgShare,
    /// `$(find-pkg-prefix package)`.
    FindPkgPrefix,
    /// `$(not x)`.
    Not,
    /// `$(and a b)`.
    And,
    /// `$(or a b)`.
    Or,
    /// `$(equals a b)`: as bools or numbers when both are, else as text.
    Equals,
    /// `$(not-equals a b)`.
    NotEquals,
    /// `$(if condition then [else])`.
    If,
}

/// Name, function, fewest and most arguments.
const KNOWN: [(&str, Function, usize, usize); 12] = [
    ("var", Function::Var, 1, 2),
    ("env", Function::Env, 1, 2),
    ("dirname", Function::Dirname, 0, 0),
    ("filename", Function::Filename, 0, 0),
    ("find-pkg-share", Function::FindPkgShare, 1, 1),
    ("find-pkg-prefix", Function::FindPkgPrefix, 1, 1),
    ("not", Function::Not, 1, 1),
    ("and", Function::And, 2, 2),
    ("or", Function::Or, 2, 2),
    ("equals", Function::Equals, 2, 2),
    ("not-equals", Function::NotEquals, 2, 2),
    ("if", Function::If, 2, 3),
];

/// What ROS 2 has too, and why it is not here.
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
    /// [`SubstitutionError`] with the known names, or with the reason why a
    /// known one of ROS 2 is not supported.
    pub fn named(name: &str) -> Result<Self, SubstitutionError> {
        if let Some((_, function, ..)) = KNOWN.iter().find(|known| known.0 == name) {
            return Ok(*function);
        }
        Err(SubstitutionError::Invalid(match REFUSED.iter().find(|refused| refused.0 == name) {
            Some((_, why)) => format!("$({name}) is not supported: {why}"),
            None => {
                let known = listed(KNOWN.iter().map(|known| known.0), "");
                format!("unknown substitution $({name}), known are {known}")
            }
        }))
    }

    pub(super) fn check_count(self, given: usize) -> Result<(), SubstitutionError> {
        let Some(&(name, _, fewest, most)) = KNOWN.iter().find(|known| known.1 == self) else {
            return Ok(());
        };
        if (fewest..=most).contains(&given) {
            return Ok(());
        }
        let takes = match (fewest, most) {
            (0, 0) => "no argument".to_owned(),
            (1, 1) => "1 argument".to_owned(),
            (a, b) if a == b => format!("{a} arguments"),
            (a, b) => format!("{a} or {b} arguments"),
        };
        Err(SubstitutionError::Invalid(format!("$({name}) takes {takes}, not {given}")))
    }
}
