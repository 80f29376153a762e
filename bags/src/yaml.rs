//! Entries and texts of YAML files of others, as [`documents`] reads them: each scalar is the text that is in the file.

use modulo_runtime::parameter::yaml_text::documents;
use saphyr::{ScalarStyle, Yaml};

/// Returns the value of `key` in the mapping at the top of `text`.
///
/// # Errors
/// The fault, with its line where the text is not YAML.
pub(crate) fn top<'a>(text: &'a str, key: &str) -> Result<Yaml<'a>, String> {
    let documents = documents(text)?;
    let value = documents.first().and_then(|document| entry(document, key));
    value.cloned().ok_or_else(|| format!("no value of '{key}' at the top of the file, where it is needed"))
}

/// Returns the value of `key` in a mapping. An entry without a value counts as absent.
pub(crate) fn entry<'a, 'text>(mapping: &'a Yaml<'text>, key: &str) -> Option<&'a Yaml<'text>> {
    let mut entries = mapping.as_mapping()?.iter();
    entries
        .find(|(name, _)| scalar(name) == Some(key))
        .map(|(_, value)| value)
        .filter(|value| !is_null(value))
}

/// Returns the text of a scalar.
pub(crate) fn scalar<'a>(node: &'a Yaml<'_>) -> Option<&'a str> {
    match node {
        Yaml::Representation(text, ..) if !is_null(node) => Some(text),
        _ => None,
    }
}

fn is_null(node: &Yaml<'_>) -> bool {
    matches!(node, Yaml::Representation(text, ScalarStyle::Plain, _) if matches!(&**text, "" | "~" | "null" | "Null" | "NULL"))
}
