//! [`Value`]: a parameter's value, and its text on command lines and in YAML.

use std::fmt;

use modulo_msgs::rcl_interfaces::{ParameterType, ParameterValue};
use serde::{Deserialize, Serialize};

use super::yaml_text;
use crate::secret::without_secrets;

/// Declares the types of values from one table: variant, type, its name in ROS 2, in `ros2 param describe` and in `ros2 param get`, and
/// its code and its field in messages.
macro_rules! kinds {
    ($($kind:ident($type:ty) $name:literal $described:literal $got:literal $code:ident $field:ident;)+) => {
        /// The value of a parameter.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        pub enum Value {
            $(#[doc = concat!("`", $name, "`")] $kind($type),)+
        }

        /// A value without the name of its type, for serde: the first type that fits is taken.
        #[derive(Serialize, Deserialize)]
        #[serde(remote = "Value", untagged)]
        pub(super) enum Plain {
            $($kind($type),)+
        }

        impl Value {
            /// Returns the type's name as ROS 2 writes it.
            pub fn type_name(&self) -> &'static str {
                match self { $(Self::$kind(_) => $name),+ }
            }
        }

        /// Code, name in `ros2 param describe` and name in `ros2 param get` of each type.
        pub(super) const TYPES: &[(u8, &str, &str)] = &[$((ParameterType::$code, $described, $got)),+];

        /// Returns a value as ROS writes it; `None` is `NOT_SET`.
        pub fn to_ros(value: Option<&Value>) -> ParameterValue {
            let mut ros = ParameterValue::default();
            match value {
                None => ros.r#type = ParameterType::PARAMETER_NOT_SET,
                $(Some(Value::$kind(v)) => (ros.r#type, ros.$field) = (ParameterType::$code, v.clone()),)+
            }
            ros
        }

        /// Converts a value of ROS; `None` when it is not set, or has a type that ROS 2 does not know.
        pub fn from_ros(value: ParameterValue) -> Option<Value> {
            Some(match value.r#type {
                $(ParameterType::$code => Value::$kind(value.$field),)+
                _ => return None,
            })
        }
    };
}

kinds! {
    Bool(bool) "bool" "boolean" "Boolean" PARAMETER_BOOL bool_value;
    Integer(i64) "integer" "integer" "Integer" PARAMETER_INTEGER integer_value;
    Double(f64) "double" "double" "Double" PARAMETER_DOUBLE double_value;
    String(String) "string" "string" "String" PARAMETER_STRING string_value;
    Bools(Vec<bool>) "bool_array" "boolean array" "Boolean" PARAMETER_BOOL_ARRAY bool_array_value;
    Integers(Vec<i64>) "integer_array" "integer array" "Integer" PARAMETER_INTEGER_ARRAY integer_array_value;
    Doubles(Vec<f64>) "double_array" "double array" "Double" PARAMETER_DOUBLE_ARRAY double_array_value;
    Strings(Vec<String>) "string_array" "string array" "String" PARAMETER_STRING_ARRAY string_array_value;
    // Behind the integers, which a list of numbers is in JSON.
    Bytes(Vec<u8>) "byte_array" "byte array" "Byte" PARAMETER_BYTE_ARRAY byte_array_value;
}

/// A value as YAML scalars.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Yaml {
    /// A single value.
    Scalar(String),
    /// The elements of an array.
    List(Vec<String>),
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Double(v) => write!(f, "{v}"),
            Self::String(v) => write!(f, "'{v}'"),
            Self::Strings(v) => write!(f, "[{}]", v.join(", ")),
            other => f.write_str(&other.to_yaml()),
        }
    }
}

impl Value {
    /// Returns the value as it may be shown: without the passwords of URLs.
    pub fn without_secrets(&self) -> Self {
        match self {
            Self::String(text) => Self::String(without_secrets(text).into_owned()),
            other => other.clone(),
        }
    }

    /// Reads `text` as a value of this value's type; an array is `[a, b]` or `a, b`, a quoted text always a string.
    pub fn parse_like(&self, text: &str) -> Option<Value> {
        let text = text.trim();
        Some(match self {
            Self::Bool(_) => Self::Bool(bool(text)?),
            Self::Integer(_) => Self::Integer(integer(text)?),
            Self::Double(_) => Self::Double(double(text)?),
            Self::String(_) => Self::String(yaml_text::string(text)?),
            Self::Bytes(_) => Self::Bytes(items(text, |item| u8::try_from(integer(item)?).ok())?),
            Self::Bools(_) => Self::Bools(items(text, bool)?),
            Self::Integers(_) => Self::Integers(items(text, integer)?),
            Self::Doubles(_) => Self::Doubles(items(text, double)?),
            Self::Strings(_) => Self::Strings(items(text, yaml_text::string)?),
        })
    }

    /// Reads `text` as a value of the type that its notation has, as `ros2 param set` does for every parameter.
    pub fn guess(text: &str) -> Value {
        let text = text.trim();
        let list = || {
            let items = yaml_text::items(text)?;
            let items: Vec<_> = items.iter().map(|item| Self::guess_scalar(item)).collect();
            // An empty list is one of bools, as in ROS 2.
            let first = items.first().unwrap_or(&Self::Bool(false));
            let alike = items.iter().all(|item| item.type_name() == first.type_name());
            let empty = match first {
                Self::Bool(_) => Self::Bools(Vec::new()),
                Self::Integer(_) => Self::Integers(Vec::new()),
                Self::Double(_) => Self::Doubles(Vec::new()),
                _ => Self::Strings(Vec::new()),
            };
            empty.parse_like(text).filter(|_| alike)
        };
        match text.starts_with('[') {
            true => list().unwrap_or_else(|| Self::String(text.to_owned())),
            false => Self::guess_scalar(text),
        }
    }

    fn guess_scalar(text: &str) -> Value {
        // A number without a decimal point is no double, and 1 is no bool.
        integer(text)
            .map(Self::Integer)
            .or_else(|| double(text).filter(|_| text.contains('.')).map(Self::Double))
            .or_else(|| bool(text).map(Self::Bool))
            .unwrap_or_else(|| Self::String(yaml_text::string(text).unwrap_or_else(|| text.to_owned())))
    }

    /// Returns this value as tables and command lines have it: a text without quotes, a zero without a sign.
    pub fn plain(&self) -> String {
        match self {
            Self::Double(v) => (v + 0.0).to_string(),
            Self::String(v) => v.clone(),
            other => other.to_string(),
        }
    }

    /// Returns this value as YAML.
    pub fn yaml(&self) -> Yaml {
        fn list<T>(items: &[T], text: impl Fn(&T) -> String) -> Yaml {
            Yaml::List(items.iter().map(text).collect())
        }
        match self {
            Self::Bool(v) => Yaml::Scalar(v.to_string()),
            Self::Integer(v) => Yaml::Scalar(v.to_string()),
            Self::Double(v) => Yaml::Scalar(yaml_text::of_double(*v)),
            Self::String(v) => Yaml::Scalar(yaml_text::of_string(v)),
            Self::Bytes(v) => list(v, u8::to_string),
            Self::Bools(v) => list(v, bool::to_string),
            Self::Integers(v) => list(v, i64::to_string),
            Self::Doubles(v) => list(v, |item| yaml_text::of_double(*item)),
            Self::Strings(v) => list(v, |item| yaml_text::of_string(item)),
        }
    }

    /// Returns this value as YAML on one line, which reads back as the same type and value.
    pub fn to_yaml(&self) -> String {
        match self.yaml() {
            Yaml::Scalar(text) => text,
            Yaml::List(items) => format!("[{}]", items.join(", ")),
        }
    }

    /// Returns this value as the type of `like`: an integer is also a double, a word is also a list of one word, and a
    /// string that is a number is also a double, since `ros2 param load` sends 1e-05 as a string. An empty array is one
    /// of any type, since `ros2 param` sends each as one of bools. Nothing else is converted.
    pub(super) fn coerced(self, like: &Value) -> Option<Value> {
        Some(match (self, like) {
            (Self::Integer(v), Self::Double(_)) => Self::Double(v as f64),
            (Self::String(v), Self::Double(_)) => Self::Double(double(&v)?),
            (Self::String(v), Self::Strings(_)) => {
                Self::Strings(if v.is_empty() { Vec::new() } else { vec![v] })
            }
            (value, like) if value.type_name() == like.type_name() => value,
            (value, like) if value.to_yaml() == "[]" && like.type_name().ends_with("_array") => {
                like.parse_like("[]")?
            }
            _ => return None,
        })
    }
}

/// Reads a list, `[a, b]` or `a, b`, whose items `read` reads.
fn items<T>(text: &str, read: impl Fn(&str) -> Option<T>) -> Option<Vec<T>> {
    yaml_text::items(text)?.iter().map(|item| read(item)).collect()
}

/// Reads a bool; YAML 1.1, which `rcl` reads, has all of these words for it.
fn bool(text: &str) -> Option<bool> {
    match text.to_ascii_lowercase().as_str() {
        "true" | "yes" | "on" | "1" => Some(true),
        "false" | "no" | "off" | "0" => Some(false),
        _ => None,
    }
}

/// Reads a decimal integer, or a hexadecimal one with `0x`.
fn integer(text: &str) -> Option<i64> {
    match text.strip_prefix("0x") {
        Some(digits) => i64::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}

/// Reads a double in Rust's notation, or YAML's `.inf` and `.nan`.
fn double(text: &str) -> Option<f64> {
    match text.to_ascii_lowercase().as_str() {
        ".inf" | "+.inf" => Some(f64::INFINITY),
        "-.inf" => Some(f64::NEG_INFINITY),
        ".nan" => Some(f64::NAN),
        _ => text.parse().ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn value() -> impl Strategy<Value = Value> {
        let text = "[ -~é\t\n]{0,12}";
        prop_oneof![
            any::<bool>().prop_map(Value::Bool),
            any::<i64>().prop_map(Value::Integer),
            any::<f64>().prop_filter("NaN is unequal to itself", |v| !v.is_nan()).prop_map(Value::Double),
            text.prop_map(Value::String),
            prop::collection::vec(any::<u8>(), 0..4).prop_map(Value::Bytes),
            prop::collection::vec(any::<bool>(), 0..4).prop_map(Value::Bools),
            prop::collection::vec(any::<i64>(), 0..4).prop_map(Value::Integers),
            prop::collection::vec(-1e300..1e300, 0..4).prop_map(Value::Doubles),
            prop::collection::vec(text, 0..4).prop_map(Value::Strings),
        ]
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back(value in value()) {
            prop_assert_eq!(value.parse_like(&value.to_yaml()), Some(value));
        }

        #[test]
        fn any_text_is_read_or_refused(value in value(), text in "\\PC{0,20}") {
            let _ = (value.parse_like(&text), Value::guess(&text));
        }
    }

    #[test]
    fn lists_read_with_and_without_brackets() {
        let list = Value::Strings(Vec::new());
        for text in ["[a, 'b, c']", "[\"a\", 'b, c']"] {
            assert_eq!(
                list.parse_like(text),
                Some(Value::Strings(vec!["a".into(), "b, c".into()])),
                "{text}"
            );
        }
        assert_eq!(list.parse_like("a,b"), Some(Value::Strings(vec!["a".into(), "b".into()])));
        assert_eq!(list.parse_like("[a"), None);
    }

    /// Each as `rclpy.parameter.get_parameter_value` reads it.
    #[test]
    fn a_value_of_no_known_type_has_the_type_of_its_notation() {
        for (text, value) in [
            ("yes", Value::Bool(true)),
            ("1", Value::Integer(1)),
            ("[1, 0]", Value::Integers(vec![1, 0])),
            ("[1, 2.5]", Value::String("[1, 2.5]".into())),
            ("2.5", Value::Double(2.5)),
            ("1e5", Value::String("1e5".into())),
            ("[]", Value::Bools(Vec::new())),
            ("[true, off]", Value::Bools(vec![true, false])),
            ("[1, -2]", Value::Integers(vec![1, -2])),
            ("[1.5, .inf]", Value::Doubles(vec![1.5, f64::INFINITY])),
            ("[a, 'b, c']", Value::Strings(vec!["a".into(), "b, c".into()])),
            ("a, b", Value::String("a, b".into())),
            ("'8'", Value::String("8".into())),
            ("[[1]]", Value::String("[[1]]".into())),
        ] {
            assert_eq!(Value::guess(text), value, "{text}");
        }
    }

    #[test]
    fn lists_of_numbers_are_read_by_their_type() {
        for (like, text, value) in [
            (Value::Bytes(Vec::new()), "[0, 255]", Some(Value::Bytes(vec![0, 255]))),
            (Value::Bytes(Vec::new()), "[256]", None),
            (Value::Bools(Vec::new()), "[yes, false]", Some(Value::Bools(vec![true, false]))),
            (Value::Integers(Vec::new()), "1, 2", Some(Value::Integers(vec![1, 2]))),
            (Value::Integers(Vec::new()), "['1']", None),
            (Value::Doubles(Vec::new()), "[1, 2.5]", Some(Value::Doubles(vec![1.0, 2.5]))),
            (Value::Doubles(Vec::new()), "[]", Some(Value::Doubles(Vec::new()))),
        ] {
            assert_eq!(like.parse_like(text), value, "{text}");
        }
    }

    #[test]
    fn numbers_are_not_quoted_and_words_need_not_be() {
        assert_eq!(Value::Integer(0).parse_like("'8'"), None);
        assert_eq!(Value::Integer(0).parse_like("0x10"), Some(Value::Integer(16)));
        assert_eq!(Value::Double(0.0).parse_like("-.inf"), Some(Value::Double(f64::NEG_INFINITY)));
        let text = "scene://tunnel?seed=3&frames=60";
        assert_eq!(Value::String(String::new()).parse_like(text), Some(Value::String(text.into())));
        assert_eq!(Value::String(String::new()).parse_like("'it''s'"), Some(Value::String("it's".into())));
    }
}
