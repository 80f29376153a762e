//! Parameters as ROS 2 has them: declared once with type, range and description, and validated as a set. A change of a
//! parameter that a node does not know is refused; one that it is started with is ignored with a warning, as in `rclcpp`.

pub mod file;
pub mod flat;
pub mod text;
pub mod typed;
mod value;
pub mod yaml_text;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::ops::RangeInclusive;

pub use typed::ParameterSet;
pub use value::{Value, from_ros, to_ros};

use crate::name::{near_or_all, nearest};
use crate::secret::without_secrets;
use crate::warning::shown;

/// The allowed values of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Allowed {
    /// Anything of its type.
    Any,
    /// An integer in this range.
    Integers(RangeInclusive<i64>),
    /// A finite double in this range.
    Doubles(RangeInclusive<f64>),
    /// The value is one of these words.
    Words(Vec<&'static str>),
}

/// The declaration of one parameter: its default gives the type.
#[derive(Clone, Debug, PartialEq)]
pub struct Descriptor {
    /// Name of the parameter in `snake_case`.
    pub name: &'static str,
    /// Initial value; its variant is the type of the parameter.
    pub default: Value,
    /// Allowed values.
    pub allowed: Allowed,
    /// Fixed at the start of the node.
    pub read_only: bool,
    /// Description in one sentence, with the unit.
    pub description: &'static str,
}

/// Error: the value of a parameter was refused. The message is one line with name, value and remedy.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("parameter '{name}' = {value}: {why}")]
pub struct ParameterError {
    /// Name of the parameter.
    pub name: String,
    /// The value that was offered.
    pub value: String,
    /// Reason of the refusal, and the possible values.
    pub why: String,
}

/// Longest name and longest value in a refusal, in characters.
const LONGEST_VALUE: usize = 200;
/// Longest reason of a refusal, in characters: those that name all parameters of a node are long.
const LONGEST_REASON: usize = 1500;

impl ParameterError {
    /// Creates a refusal of `value` for `name`, without a password that a URL in it has. All three may come from a peer, and are
    /// shortened.
    pub fn new(name: impl Into<String>, value: impl fmt::Display, why: impl Into<String>) -> Self {
        let name = shown(&name.into(), LONGEST_VALUE);
        let value = shown(&without_secrets(&value.to_string()), LONGEST_VALUE);
        Self { name, value, why: shown(&without_secrets(&why.into()), LONGEST_REASON) }
    }
}

/// A declared set of parameters. Every parameter always has an allowed value of its declared type.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    declared: Vec<Descriptor>,
    values: BTreeMap<&'static str, Value>,
}

impl Descriptor {
    /// Reads `text`, a command line's or a YAML scalar's, as a value of this parameter.
    ///
    /// # Errors
    /// [`ParameterError`] with the possible values.
    pub fn read(&self, text: &str) -> Result<Value, ParameterError> {
        let value = self.default.parse_like(text).ok_or_else(|| {
            ParameterError::new(self.name, text, format!("is not a {}", self.default.type_name()))
        })?;
        self.accept(value)
    }

    /// Checks type and range, and converts where that loses nothing.
    ///
    /// # Errors
    /// [`ParameterError`] with the possible values.
    pub fn accept(&self, value: Value) -> Result<Value, ParameterError> {
        let shown = value.to_string();
        let refuse = |why: String| ParameterError::new(self.name, &shown, why);
        let given = value.type_name();
        // An integer is also accepted for a double, as command lines and YAML write 2 for 2.0.
        let value = value.coerced(&self.default).ok_or_else(|| {
            refuse(format!("is of type {given}, must be of type {}", self.default.type_name()))
        })?;
        match (&value, &self.allowed) {
            (_, Allowed::Any) => Ok(value),
            (Value::Integer(v), Allowed::Integers(range)) if range.contains(v) => Ok(value),
            // `contains` is false for NaN, which is refused by that.
            (Value::Double(v), Allowed::Doubles(range)) if range.contains(v) => Ok(value),
            (Value::String(v), Allowed::Words(words)) if words.contains(&v.as_str()) => Ok(value),
            (_, allowed) => Err(refuse(format!("must be {allowed}"))),
        }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Any => write!(f, "any value"),
            Self::Integers(range) => write!(f, "in {} to {}", range.start(), range.end()),
            Self::Doubles(range) => write!(f, "a finite number in {} to {}", range.start(), range.end()),
            Self::Words(words) => write!(f, "one of {}", words.join(", ")),
        }
    }
}

impl Parameters {
    /// Declares a set; every parameter has its default.
    pub fn declare(declared: Vec<Descriptor>) -> Self {
        let values = declared.iter().map(|d| (d.name, d.default.clone())).collect();
        Self { declared, values }
    }

    /// Returns the declarations, in order.
    pub fn descriptors(&self) -> &[Descriptor] {
        &self.declared
    }

    /// Returns the declaration of `name`.
    pub fn descriptor(&self, name: &str) -> Option<&Descriptor> {
        self.declared.iter().find(|d| d.name == name)
    }

    /// Returns the parameters whose values in `next`, a set with the same declarations, are others, with those values.
    pub fn changed<'a>(&'a self, next: &'a Self) -> impl Iterator<Item = (&'static str, &'a Value)> {
        let values =
            next.declared.iter().filter_map(|declared| Some((declared.name, next.get(declared.name)?)));
        values.filter(|(name, value)| self.get(name) != Some(*value))
    }

    /// Returns the value of `name`, if it is declared.
    pub fn get(&self, name: &str) -> Option<&Value> {
        self.values.get(name)
    }

    /// Returns the set with all `changes`, or none when one is refused. `started` refuses changes of fixed ones.
    ///
    /// # Errors
    /// [`ParameterError`] of the first change that is not possible.
    pub fn with(&self, changes: &[(String, Value)], started: bool) -> Result<Self, ParameterError> {
        // Changes go to a copy, so that one that is refused leaves no trace of those before it.
        let mut next = self.clone();
        for (name, value) in changes {
            let descriptor = self.descriptor(name).ok_or_else(|| self.unknown(name, value))?;
            let mut accepted = descriptor.accept(value.clone())?;
            // A node takes back its own `ros2 param dump`, in which passwords are hidden.
            if let Some(own) = self.get(name).filter(|own| own.without_secrets() == accepted) {
                accepted = own.clone();
            }
            // The value that it has is no change.
            if started && descriptor.read_only && self.get(name) != Some(&accepted) {
                let why = "is read-only: set it when the node is started";
                return Err(ParameterError::new(name, value, why));
            }
            next.values.insert(descriptor.name, accepted);
        }
        Ok(next)
    }

    /// Applies values that are given as text, as [`Parameters::with`] does, before the start of the node.
    ///
    /// # Errors
    /// [`ParameterError`] of the first one that is not possible.
    pub fn with_text<S: AsRef<str>>(&self, changes: &[(S, S)]) -> Result<Self, ParameterError> {
        let typed: Result<Vec<_>, _> = changes
            .iter()
            .map(|(name, text)| {
                let (name, text) = (name.as_ref(), text.as_ref());
                let descriptor = self.descriptor(name).ok_or_else(|| self.unknown(name, text))?;
                Ok((name.to_owned(), descriptor.read(text)?))
            })
            .collect();
        self.with(&typed?, false)
    }

    /// Returns those of `settings` that are declared. As in `rclcpp`, `node` ignores the others, since a parameter file or a
    /// launch file may set them for all nodes of a stack; one warning names them all.
    pub fn known_of(&self, settings: Vec<(String, String)>, node: &str) -> Vec<(String, String)> {
        let (known, unknown): (Vec<_>, Vec<_>) =
            settings.into_iter().partition(|(name, _)| self.descriptor(name).is_some());
        if let Some(warning) = self.ignored(&unknown) {
            tracing::warn!(node, "{warning}");
        }
        known
    }

    /// Returns the warning about settings of parameters that are not declared; `None` when there are none.
    fn ignored(&self, unknown: &[(String, String)]) -> Option<String> {
        let names: BTreeSet<_> = unknown.iter().map(|(name, _)| name).collect();
        let named = names.iter().map(|name| match self.near(name) {
            Some(near) => format!("'{name}' (did you mean '{near}'?)"),
            None => format!("'{name}'"),
        });
        let named = named.collect::<Vec<_>>().join(", ");
        (!names.is_empty()).then(|| format!("parameters that this node does not have are ignored: {named}"))
    }

    /// Returns the declared name that `name` is most likely a misspelling of.
    pub fn near(&self, name: &str) -> Option<&'static str> {
        nearest(name, self.declared.iter().map(|descriptor| descriptor.name))
    }

    fn unknown(&self, name: &str, value: impl fmt::Display) -> ParameterError {
        let known: Vec<_> = self.declared.iter().map(|d| d.name).collect();
        ParameterError::new(
            name,
            value,
            format!("unknown parameter{}", near_or_all(name, &known, ", known are")),
        )
    }
}

#[cfg(test)]
pub(crate) mod sample {
    crate::parameters! {
        /// A part of another set.
        pub struct Part {
            /// Two lines of help are one sentence.
            share: f64 = 0.5 => 0.0..=1.0,
        }
    }

    crate::parameters! {
        /// The parameters of a node, for the tests: one of each type.
        pub struct Set {
            /// A double.
            angle: f64 = 4.0 => 0.001..=1024.0,
            /// An integer.
            bits: u8 = 8 => 1..=16; fixed,
            /// A word.
            engine: u8 = 0 => [("auto", 0), ("ort", 1), ("rten", 2)],
            /// A list.
            wait_for: Vec<String> = Vec::new(),
            /// A text.
            model: String = "a.onnx".to_owned(); fixed,
            /// A switch.
            r#loop: bool = false,
            ..part: Part,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sample::Set;

    fn set() -> Parameters {
        Parameters::declare(Set::descriptors())
    }

    fn text(name: &str, value: &str) -> Result<Parameters, ParameterError> {
        set().with_text(&[(name, value)])
    }

    #[test]
    fn an_integer_is_also_a_double() {
        assert_eq!(text("angle", "2").expect("2 is a double").get("angle"), Some(&Value::Double(2.0)));
        let changed = set().with(&[("angle".into(), Value::Integer(3))], true).expect("3 is a double");
        assert_eq!(changed.get("angle"), Some(&Value::Double(3.0)));
    }

    #[test]
    fn refusals_name_parameter_value_and_remedy() {
        for (name, value, remedy) in [
            ("angle", "0", "0.001 to 1024"),
            ("angle", "NaN", "finite"),
            ("bits", "17", "1 to 16"),
            ("bits", "eight", "integer"),
            ("engine", "tensorrt", "auto, ort, rten"),
            ("gain", "1", "angle, bits, engine"),
        ] {
            let message = text(name, value).expect_err("must be refused").to_string();
            assert!(
                message.contains(name) && message.contains(value) && message.contains(remedy),
                "{message}"
            );
        }
    }

    /// A peer sent 64 KiB with a line of its own to a running node, whose log and answer repeated them.
    #[test]
    fn a_refusal_is_one_short_line() {
        let long = "a\nWARN forged\0\u{1b}[2J".to_owned() + &"x".repeat(64 << 10);
        for name in ["engine", &long] {
            let why = set().with(&[(name.to_owned(), Value::String(long.clone()))], true);
            let line = why.expect_err("must be refused").to_string();
            assert!(line.len() < 800 && !line.contains(char::is_control), "{line}");
            assert!(line.contains("a\\nWARN forged\\u{0}\\u{1b}[2Jxxx"), "{line}");
        }
        let error = ParameterError::new("model", "a.onnx", &*long);
        assert!(error.why.len() < 2000 && !error.why.contains(char::is_control), "{}", error.why);
    }

    #[test]
    fn settings_of_other_nodes_are_ignored_with_one_warning() {
        let given = |names: &[&str]| names.iter().map(|name| ((*name).to_owned(), "2".to_owned())).collect();
        let all: Vec<_> =
            given(&["wheel_radius", "angle", "agnle", "qos_overrides./clock.subscription.depth"]);
        assert_eq!(set().known_of(all.clone(), "/n"), given(&["angle"]));
        let unknown: Vec<_> = all.into_iter().filter(|(name, _)| name != "angle").collect();
        let printed = set().ignored(&unknown).expect("three are unknown");
        assert!(
            printed.contains("'agnle' (did you mean 'angle'?)") && printed.contains("'wheel_radius'"),
            "{printed}"
        );
        assert_eq!(printed.matches("did you mean").count(), 1, "{printed}");
        assert_eq!(set().ignored(&[]), None);
        assert!(text("agnle", "2").expect_err("unknown").to_string().contains("did you mean 'angle'?"));
    }

    #[test]
    fn passwords_are_not_shown_and_stay() {
        let camera = "rtsp://admin:s3cret@cam/1";
        let set = text("model", camera).expect("a text");
        let why = set
            .with(&[("model".into(), Value::String("rtsp://admin:other@cam".into()))], true)
            .expect_err("fixed");
        assert!(!why.to_string().contains("other") && why.to_string().contains("@cam"), "{why}");
        let dumped = set.get("model").expect("declared").without_secrets();
        assert_eq!(dumped, Value::String("rtsp://***@cam/1".into()));
        let same = set.with(&[("model".into(), dumped)], true).expect("no change");
        assert_eq!(same.get("model"), Some(&Value::String(camera.into())));
    }

    #[test]
    fn read_only_holds_after_the_start_alone() {
        let change = [("bits".to_owned(), Value::Integer(10))];
        assert!(set().with(&change, false).is_ok());
        assert!(set().with(&change, true).is_err());
        let same = [("bits".to_owned(), Value::Integer(8))];
        assert!(set().with(&same, true).is_ok(), "a node takes back its own dump");
    }
}
