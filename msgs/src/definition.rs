//! Reads `.msg` text: one field, constant or comment a line.
//!
//! ```text
//! uint8 LEVEL=3                 # a constant: not a field
//! string<=255 name "none"       # bounded string with a default
//! geometry_msgs/Point[<=4] at   # bounded sequence of another package's type
//! ```
//!
//! Source: <https://design.ros2.org/articles/legacy_interface_definition.html>

use crate::type_description_interfaces::{Field, FieldType};

/// Error of a line that is not part of a definition, of a type that is missing or contains itself, or of a crate that is built without
/// the feature `hashes`.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct DefinitionError(pub(crate) String);

impl DefinitionError {
    /// Returns the error of a line of the type `name` that cannot be read.
    pub(crate) fn line(name: &str, line: &str) -> Self {
        Self(format!("{name}: '{line}' is not a field; expected TYPE NAME, such as 'float64[9] k'"))
    }

    /// Returns the error of a type that is used and that nothing defines.
    pub(crate) fn missing(name: &str) -> Self {
        Self(format!("no definition of '{name}', expected one after a line 'MSG: {name}'"))
    }
}

/// Returns the fields that `text` gives the type `name`. A type without fields gets the one that ROS gives it,
/// `structure_needs_at_least_one_member`.
pub(crate) fn parse_fields(name: &str, text: &str) -> Result<Vec<Field>, DefinitionError> {
    let package = name.split_once('/').map_or(name, |(package, _)| package);
    let mut fields = Vec::new();
    for line in text.lines().map(without_comment).filter(|line| !line.is_empty()) {
        fields.extend(parse_line(package, line).ok_or_else(|| DefinitionError::line(name, line))?);
    }
    // The generators of ROS add this field, since an empty struct is not possible in C. It is part of the type hash.
    if fields.is_empty() {
        let r#type = FieldType { type_id: FieldType::UINT8, ..FieldType::default() };
        let name = "structure_needs_at_least_one_member".to_owned();
        fields.push(Field { name, r#type, default_value: String::new() });
    }
    Ok(fields)
}

/// Returns `pkg/Name` as `pkg/msg/Name`. A name without a package belongs to `package`, unless `package` is empty.
pub(crate) fn full_name(package: &str, name: &str) -> Option<String> {
    let word = |w: &str| !w.is_empty() && w.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    let parts: Vec<_> = name.split('/').collect();
    if !parts.iter().all(|part| word(part)) {
        return None;
    }
    // Definitions write `pkg/Name` or, within a package, `Name`. Bags also write `pkg/msg/Name`, the name in ROS 2.
    match parts[..] {
        [name] if !package.is_empty() => Some(format!("{package}/msg/{name}")),
        [package, name] => Some(format!("{package}/msg/{name}")),
        [_, _, _] => Some(name.to_owned()),
        _ => None,
    }
}

impl FieldType {
    /// `type_id` of a message type.
    pub const NESTED: u8 = 1;
    /// `type_id` of a byte, which also has the name [`FieldType::BYTE`].
    pub(crate) const UINT8: u8 = 3;
    pub(crate) const BYTE: u8 = 16;
    /// Added to `type_id` for an array of `capacity` elements.
    pub const ARRAY: u8 = 48;
    /// Added to `type_id` for a sequence of at most `capacity` elements.
    pub const BOUNDED_SEQUENCE: u8 = 96;
    /// Added to `type_id` for a sequence of any length.
    pub const UNBOUNDED_SEQUENCE: u8 = 144;
}

const STRING: u8 = 17;
const WSTRING: u8 = 18;
/// Added to the code of an unbounded string to get that of a bounded one.
const BOUNDED_STRING: u8 = 4;

fn without_comment(line: &str) -> &str {
    line.split_once('#').map_or(line, |(text, _)| text).trim()
}

/// Returns the field that a line defines, or `Some(None)` for a constant; `None` for any other line.
fn parse_line(package: &str, line: &str) -> Option<Option<Field>> {
    // A constant and a field start alike, `TYPE NAME`. Only the text behind the name distinguishes them: `=` and a
    // value is a constant, nothing or a value is a field with its default.
    let (type_text, rest) = line.split_once(char::is_whitespace)?;
    let rest = rest.trim_start();
    let end = rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(rest.len());
    let (name, tail) = rest.split_at(end);
    let value = tail.trim();
    if name.is_empty() {
        return None;
    }
    if value.starts_with('=') {
        return Some(None);
    }
    // Without this check, `uint8 a-b` would be the field `a` with the default `-b`.
    if !tail.is_empty() && !tail.starts_with(char::is_whitespace) {
        return None;
    }
    let r#type = parse_type(package, type_text)?;
    Some(Some(Field { name: name.to_owned(), r#type, default_value: value.to_owned() }))
}

fn parse_type(package: &str, text: &str) -> Option<FieldType> {
    let (element, brackets) = match text.split_once('[') {
        Some((element, rest)) => (element, Some(rest.strip_suffix(']')?)),
        None => (text, None),
    };
    let (many, capacity) = match brackets {
        None => (0, 0),
        Some("") => (FieldType::UNBOUNDED_SEQUENCE, 0),
        Some(size) => match size.strip_prefix("<=") {
            Some(bound) => (FieldType::BOUNDED_SEQUENCE, bound.parse().ok()?),
            // An array without elements would be a value of no bytes, of which a message could claim any number.
            None => (FieldType::ARRAY, size.parse().ok().filter(|size| *size > 0)?),
        },
    };
    // The bound of a sequence, `[<=4]`, was cut off before: the `<=` that is left bounds a string.
    let one = parse_element(package, element)?;
    Some(FieldType { type_id: one.type_id + many, capacity, ..one })
}

fn parse_element(package: &str, text: &str) -> Option<FieldType> {
    if let Some((string, bound)) = text.split_once("<=") {
        let type_id = primitive(string).filter(|id| [STRING, WSTRING].contains(id))? + BOUNDED_STRING;
        return Some(FieldType { type_id, string_capacity: bound.parse().ok()?, ..FieldType::default() });
    }
    if let Some(type_id) = primitive(text) {
        return Some(FieldType { type_id, ..FieldType::default() });
    }
    let nested_type_name = full_name(package, text)?;
    Some(FieldType { type_id: FieldType::NESTED, nested_type_name, ..FieldType::default() })
}

/// Returns the code of a primitive type in `type_description_interfaces/msg/FieldType`.
fn primitive(name: &str) -> Option<u8> {
    Some(match name {
        "int8" => 2,
        "uint8" | "char" => FieldType::UINT8,
        "int16" => 4,
        "uint16" => 5,
        "int32" => 6,
        "uint32" => 7,
        "int64" => 8,
        "uint64" => 9,
        "float32" => 10,
        "float64" => 11,
        // Codes 12 to 14 are long double, char and wide char of IDL, which no `.msg` type uses.
        "bool" => 15,
        "byte" => FieldType::BYTE,
        "string" => STRING,
        "wstring" => WSTRING,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn tells_fields_from_constants_and_comments() {
        let text = "# said\nuint8 A = 1\nstring<=9[<=4] s \"x\" # why\n\nPoint[3] at\nb/C c 1.5\n";
        let fields = parse_fields("a/msg/T", text).expect("all lines are good");
        let short: Vec<_> = fields
            .iter()
            .map(|f| {
                let t = &f.r#type;
                let nested = t.nested_type_name.as_str();
                (f.name.as_str(), t.type_id, t.capacity, t.string_capacity, nested, f.default_value.as_str())
            })
            .collect();
        let expected = [
            ("s", 21 + 96, 4, 9, "", "\"x\""),
            ("at", 1 + 48, 3, 0, "a/msg/Point", ""),
            ("c", 1, 0, 0, "b/msg/C", "1.5"),
        ];
        assert_eq!(short, expected);
    }

    #[test]
    fn refuses_lines_that_are_no_fields() {
        for line in
            ["uint8", "uint8[0] a", "uint8[ a", "uint8[x] a", "int8<=3 a", "a//B c", "uint8 a-b", "a/b/c/D e"]
        {
            let error = parse_fields("a/msg/T", line).expect_err(line).to_string();
            assert!(error.contains("a/msg/T") && error.contains(line), "{error}");
        }
    }

    proptest! {
        #[test]
        fn each_line_of_any_text_is_a_field_or_is_named(
            text in "([a-z0-9/<=\\[\\]# _\"-]{0,30}\n){0,4}|((u?int8|string<=9|a/B)(\\[<?=?[0-9]?\\])? [a-c]( 1|=2| # c)?\n){0,4}|\\PC{0,60}",
        ) {
            let lines: Vec<_> = text.lines().map(without_comment).filter(|line| !line.is_empty()).collect();
            match parse_fields("a/msg/T", &text) {
                Ok(fields) => {
                    let constants = lines.iter().filter(|line| line.replace("<=", "").contains('=')).count();
                    prop_assert!(fields.len() <= lines.len().max(1) && fields.len() + constants >= lines.len());
                    // In their order, with their names.
                    let mut left = lines.iter();
                    let found = fields.iter().all(|field| left.any(|line| line.contains(&field.name)));
                    prop_assert!(found || fields[0].name == "structure_needs_at_least_one_member");
                    prop_assert!(fields.iter().all(|field| !field.name.is_empty()));
                }
                Err(DefinitionError(why)) => {
                    let is_named = |line: &&str| why.starts_with(&format!("a/msg/T: '{line}' is not a field"));
                    prop_assert!(lines.iter().any(is_named), "{why}");
                }
            }
        }
    }
}
