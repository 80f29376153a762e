//! [`ParameterText`]: the value of a parameter as text that ROS 2 reads with
//! YAML's rules. The node's own declaration gives it its type in the end.

use std::fmt;
use std::path::Path;

use modulo_runtime::parameter::yaml_text::of_string;
use serde::Serialize;

use crate::yaml::{Content, ScalarType};

/// The value of a parameter.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ParameterText {
    /// The value as text, a list as `[a, b]`.
    pub text: String,
    /// The type that the launch file asks for, such as `str` or `list_of_int`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<&'static str>,
}

impl ParameterText {
    /// A scalar; a `kind` is checked, and a `float` gets its decimal point.
    ///
    /// # Errors
    /// What `text` is not, as text.
    pub(super) fn scalar(text: String, kind: Option<&'static str>) -> Result<Self, String> {
        let text = match kind {
            Some(of) if !of.starts_with("list_of_") => typed(text, of)?,
            _ if is_value(&text) => text,
            _ => {
                return Err(format!(
                    "= '{text}' is neither a scalar nor a list to ROS 2, give it type: \"str\""
                ));
            }
        };
        Ok(Self { text, kind })
    }

    /// A list of (text, type as it is written).
    ///
    /// # Errors
    /// Which item does not have the type that is asked for, as text.
    pub(super) fn list(
        items: Vec<(String, Option<ScalarType>)>,
        kind: Option<&'static str>,
    ) -> Result<Self, String> {
        let of = match kind.map(|kind| kind.strip_prefix("list_of_").ok_or(kind)) {
            Some(Err(kind)) => return Err(format!("is a list, must be a {kind}")),
            Some(Ok(of)) => of,
            None => "",
        };
        let items: Result<Vec<String>, String> = items
            .into_iter()
            .map(|(text, kind)| {
                let text = typed(text, of)?;
                let is_string = of == "str" || (of.is_empty() && kind == Some(ScalarType::String));
                Ok(if is_string { of_string(&text) } else { text })
            })
            .collect();
        Ok(Self { text: format!("[{}]", items?.join(", ")), kind })
    }

    /// The text to write after `name:=` on a ROS 2 command line.
    pub fn as_yaml(&self) -> String {
        if self.kind == Some("str") { of_string(&self.text) } else { self.text.clone() }
    }
}

impl fmt::Display for ParameterText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.as_yaml())
    }
}

fn typed(text: String, of: &str) -> Result<String, String> {
    let fits = match of {
        "int" => text.parse::<i64>().is_ok(),
        "float" => text.parse::<f64>().is_ok(),
        "bool" => ScalarType::of_plain(&text) == ScalarType::Bool,
        _ => true,
    };
    if !fits {
        return Err(format!("= {text} is no {of}"));
    }
    Ok(if of == "float" && text.parse::<i64>().is_ok() { format!("{text}.0") } else { text })
}

/// Whether YAML's rules make a scalar or a list of scalars of `text`, and every reader of YAML the same one.
fn is_value(text: &str) -> bool {
    match crate::yaml::read(Path::new(""), text).map(|item| item.content) {
        Ok(Content::Scalar(_, kind)) => kind != ScalarType::Null,
        Ok(Content::List(items)) => {
            !items.is_empty() && items.iter().all(|item| matches!(item.content, Content::Scalar(..)))
        }
        Ok(Content::Map(_)) | Err(_) => false,
    }
}

#[cfg(test)]
mod tests {
    use modulo_runtime::parameter::yaml_text;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// `\'` and `\u{7f}` of Rust are not YAML.
        #[test]
        fn a_string_reads_back(text in "[ -~\n\t\u{7f}\u{85}é']{0,8}") {
            let scalar = ParameterText::scalar(text.clone(), Some("str")).expect("any text is a string");
            prop_assert_eq!(yaml_text::string(&scalar.as_yaml()), Some(text.clone()));
            let list = ParameterText::list(vec![(text.clone(), Some(ScalarType::String))], Some("list_of_str"));
            prop_assert_eq!(yaml_text::strings(&list.expect("strings").as_yaml()), Some(vec![text]));
        }
    }
}
