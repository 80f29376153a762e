//! JSON as Python writes it, with `NaN` and `Infinity`, and lists of which a bad entry costs only itself.

use std::borrow::Cow;

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

/// The words of Python that JSON does not have.
const WORDS: [&str; 3] = ["-Infinity", "Infinity", "NaN"];

/// Returns `text` with the words of Python outside of strings in quotes.
pub(super) fn quoted(text: &str) -> Cow<'_, str> {
    let (mut parts, mut copied, mut at, mut in_string) = (String::new(), 0, 0, false);
    while let Some(byte) = text.as_bytes().get(at) {
        match byte {
            // Behind a backslash, a quote does not end a string.
            b'\\' if in_string => at += 1,
            b'"' => in_string = !in_string,
            b'-' | b'I' | b'N' if !in_string => {
                if let Some(word) = WORDS.iter().find(|word| text[at..].starts_with(**word)) {
                    parts.extend([&text[copied..at], "\"", word, "\""]);
                    at += word.len() - 1;
                    copied = at + 1;
                }
            }
            _ => {}
        }
        at += 1;
    }
    if copied == 0 {
        return Cow::Borrowed(text);
    }
    parts.push_str(&text[copied..]);
    Cow::Owned(parts)
}

/// An entry of a list, or why it cannot be read.
#[derive(Deserialize)]
#[serde(from = "Value", bound = "T: DeserializeOwned")]
pub(super) struct Listed<T>(pub Result<T, String>);

impl<T: DeserializeOwned> From<Value> for Listed<T> {
    fn from(value: Value) -> Self {
        Self(T::deserialize(value).map_err(|why| why.to_string()))
    }
}

/// A number, or a text that is one.
#[derive(Clone, Copy, Deserialize)]
#[serde(try_from = "Value")]
pub(super) struct Number(pub f64);

impl TryFrom<Value> for Number {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        let number = match &value {
            Value::Number(number) => number.as_f64(),
            Value::String(text) => text.trim().parse().ok(),
            Value::Bool(truth) => Some(f64::from(u8::from(*truth))),
            _ => None,
        };
        number.map(Self).ok_or_else(|| format!("{value} found, a number needed"))
    }
}

/// The id of an image or a category, a whole number or another text.
#[derive(Clone, Deserialize, PartialEq, Eq, Hash)]
#[serde(try_from = "Value")]
pub(super) struct Id(pub String);

impl TryFrom<Value> for Id {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        match &value {
            Value::String(text) => Ok(Self(text.clone())),
            Value::Number(number) if number.is_f64() => {
                let whole = number.as_f64().filter(|number| number.fract() == 0.0 && number.abs() < 1e15);
                whole
                    .map(|number| Self((number as i64).to_string()))
                    .ok_or(format!("id {value} found, a whole number needed"))
            }
            Value::Number(number) => Ok(Self(number.to_string())),
            _ => Err(format!("id {value} found, a whole number or a text needed")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_python_are_quoted_outside_of_strings() {
        for (text, expected) in [
            (r#"{"a": NaN, "b": [Infinity,-Infinity]}"#, r#"{"a": "NaN", "b": ["Infinity","-Infinity"]}"#),
            (r#"["NaN", "-Infinity \" NaN", "\\", NaN]"#, r#"["NaN", "-Infinity \" NaN", "\\", "NaN"]"#),
            (r#"["é", -1, "Näh\"#, r#"["é", -1, "Näh\"#),
        ] {
            assert_eq!(quoted(text), expected);
        }
        assert!(matches!(quoted("[1, -2]"), Cow::Borrowed(_)), "nothing is copied");
    }

    #[test]
    fn a_bad_entry_costs_only_itself() {
        let read: Vec<Listed<Vec<Number>>> =
            serde_json::from_str(&quoted(r#"[[1, "2.5"], null, ["wide"], [NaN, true]]"#)).expect("a list");
        let read: Vec<_> = read.into_iter().map(|entry| entry.0).collect();
        let numbers = |entry: &Result<Vec<Number>, String>| {
            entry.as_ref().map(|numbers| numbers.iter().map(|number| number.0).collect::<Vec<_>>()).ok()
        };
        assert_eq!(numbers(&read[0]), Some(vec![1.0, 2.5]));
        assert!(read[1].is_err() && read[2].as_ref().is_err_and(|why| why.contains("a number needed")));
        assert!(numbers(&read[3]).is_some_and(|numbers| numbers[0].is_nan() && numbers[1] == 1.0));
    }
}
