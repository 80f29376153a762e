//! [`Value`]: a parameter's value, and its text on command lines and in YAML.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::yaml_text;

/// The value of a parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Value {
    /// `bool`
    Bool(bool),
    /// `integer`
    Integer(i64),
    /// `double`
    Double(f64),
    /// `string`
    String(String),
    /// `string_array`
    Strings(Vec<String>),
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool(v) => write!(f, "{v}"),
            Self::Integer(v) => write!(f, "{v}"),
            Self::Double(v) => write!(f, "{v}"),
            Self::String(v) => write!(f, "'{v}'"),
            Self::Strings(v) => write!(f, "[{}]", v.join(", ")),
        }
    }
}

impl Value {
    /// Returns the type's name as ROS 2 writes it.
    pub fn type_name(&self) -> &'static str {
        match self {
            Self::Bool(_) => "bool",
            Self::Integer(_) => "integer",
            Self::Double(_) => "double",
            Self::String(_) => "string",
            Self::Strings(_) => "string_array",
        }
    }

    /// Reads `text` (a command line's or a YAML scalar's) as a value of this value's type. An array is written `[a, b]`
    /// or `a, b`. A quoted text is always a string.
    pub fn parse_like(&self, text: &str) -> Option<Value> {
        let text = text.trim();
        Some(match self {
            // YAML 1.1, which `rcl` reads, has all of these words for a boolean.
            Self::Bool(_) => Self::Bool(match text.to_ascii_lowercase().as_str() {
                "true" | "yes" | "on" | "1" => true,
                "false" | "no" | "off" | "0" => false,
                _ => return None,
            }),
            Self::Integer(_) => Self::Integer(integer(text)?),
            Self::Double(_) => Self::Double(double(text)?),
            Self::String(_) => Self::String(yaml_text::string(text)?),
            Self::Strings(_) => Self::Strings(yaml_text::strings(text)?),
        })
    }

    /// Returns this value as YAML on one line, which reads back as the same type and value.
    pub fn to_yaml(&self) -> String {
        match self {
            Self::Bool(v) => v.to_string(),
            Self::Integer(v) => v.to_string(),
            Self::Double(v) => yaml_text::of_double(*v),
            Self::String(v) => yaml_text::of_string(v),
            Self::Strings(v) => {
                format!(
                    "[{}]",
                    v.iter().map(|item| yaml_text::of_string(item)).collect::<Vec<_>>().join(", ")
                )
            }
        }
    }

    /// Returns this value as the type of `like`: an integer is also a double, a word is also a list of one word, and a
    /// string that is a number is also a double, since `ros2 param load` sends 1e-05 as a string. Nothing else is
    /// converted.
    pub(super) fn coerced(self, like: &Value) -> Option<Value> {
        Some(match (self, like) {
            (Self::Integer(v), Self::Double(_)) => Self::Double(v as f64),
            (Self::String(v), Self::Double(_)) => Self::Double(double(&v)?),
            (Self::String(v), Self::Strings(_)) => {
                Self::Strings(if v.is_empty() { Vec::new() } else { vec![v] })
            }
            (value, like) if value.type_name() == like.type_name() => value,
            _ => return None,
        })
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
            let _ = value.parse_like(&text);
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
