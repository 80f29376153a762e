//! Reading parameters: `{name, value[, type]}`, `{name, param: [...]}` and
//! `{from: file}`.

use crate::attributes::{Attributes, Text};
use crate::error::{LaunchError, listed};
use crate::substitution::{Part, Template};
use crate::yaml::{Content, Item, ScalarType};

const KEYS: [&str; 5] = ["name", "value", "type", "param", "from"];
const SCALARS: [ScalarType; 4] =
    [ScalarType::Integer, ScalarType::Float, ScalarType::Bool, ScalarType::String];
/// The parameter types of ROS 2's launch files.
const TYPES: [&str; 8] =
    ["int", "float", "bool", "str", "list_of_int", "list_of_float", "list_of_bool", "list_of_str"];

/// A parameter or a file of parameters.
#[derive(Clone, Debug)]
pub(crate) enum Parameter {
    /// A file in ROS 2's parameter format.
    File(Text),
    /// One parameter; nested names are joined with dots.
    Value { name: Text, value: ParameterValue, kind: Option<&'static str> },
}

/// The value of a parameter.
#[derive(Clone, Debug)]
pub(crate) enum ParameterValue {
    /// A scalar.
    Scalar(Written),
    /// A list of scalars.
    List(Vec<Written>),
}

/// A scalar with its type as it is written; the type is `None` where a substitution decides on it.
pub(crate) type Written = (Text, Option<ScalarType>);

/// The parameters in the list `param`.
pub(super) fn parameters(attributes: &Attributes<'_>) -> Result<Vec<Parameter>, LaunchError> {
    let mut all = Vec::new();
    collect(attributes, None, &mut all)?;
    Ok(all)
}

fn collect(
    attributes: &Attributes<'_>,
    outer: Option<&Text>,
    all: &mut Vec<Parameter>,
) -> Result<(), LaunchError> {
    for entry in attributes.entries("param", &KEYS)? {
        if let Some(file) = entry.text("from")? {
            let alone = outer.is_none() && KEYS[..4].iter().all(|key| entry.item(key).is_none());
            if !alone {
                return Err(entry.refuse(file.line, "'from' stands alone, not nested and without other keys"));
            }
            all.push(Parameter::File(file));
            continue;
        }
        let name = joined(outer, entry.required("name")?);
        match (entry.item("value"), entry.item("param")) {
            (Some(item), None) => {
                let kind = kind(&entry)?;
                check_types(&entry, item, kind)?;
                all.push(Parameter::Value { name, value: read(&entry, item)?, kind });
            }
            (None, Some(_)) => collect(&entry, Some(&name), all)?,
            _ => return Err(entry.refuse(entry.line, "one of 'value' and 'param' is needed")),
        }
    }
    Ok(())
}

fn joined(outer: Option<&Text>, inner: Text) -> Text {
    let Some(outer) = outer else { return inner };
    let mut parts = outer.template.parts.clone();
    parts.push(Part::Text(".".to_owned()));
    parts.extend(inner.template.parts);
    let source = format!("{}.{}", outer.source, inner.source);
    Text { line: inner.line, source, template: Template { parts } }
}

fn kind(entry: &Attributes<'_>) -> Result<Option<&'static str>, LaunchError> {
    let Some(text) = entry.text("type")? else { return Ok(None) };
    let given = text.source.as_str();
    let known = TYPES.iter().find(|kind| **kind == given).copied();
    known.map(Some).ok_or_else(|| {
        entry.refuse(text.line, format!("type: unknown '{given}', known are {}", listed(TYPES, "")))
    })
}

/// Checks the types of `item`. ROS 2 converts a string with a substitution to the type that is asked for, and nothing
/// else. The items of a list are of one type beside such strings.
fn check_types(entry: &Attributes<'_>, item: &Item, kind: Option<&str>) -> Result<(), LaunchError> {
    let (items, of) = match (&item.content, kind) {
        (Content::List(items), Some(kind)) => match kind.strip_prefix("list_of_") {
            Some(of) => (items.as_slice(), Some(of)),
            None => return Err(entry.refuse(item.line, format!("value: is a list, must be of type {kind}"))),
        },
        (Content::List(items), None) => (items.as_slice(), None),
        (_, Some(kind)) if kind.starts_with("list_of_") => {
            return Err(entry.refuse(item.line, format!("value: is no list, must be of type {kind}")));
        }
        (_, kind) => (std::slice::from_ref(item), kind),
    };
    let type_of = |item: &Item| match &item.content {
        Content::Scalar(text, ScalarType::String) if text.contains("$(") => None,
        Content::Scalar(_, ScalarType::String) => Some("str"),
        Content::Scalar(_, ScalarType::Bool) => Some("bool"),
        Content::Scalar(_, ScalarType::Integer) => Some("int"),
        Content::Scalar(_, ScalarType::Float) => Some("float"),
        _ => None,
    };
    let first = items.iter().find_map(type_of);
    for item in items {
        let given = type_of(item);
        let wrong = |must: &str| {
            let why = format!("value: {} must be of type {must}", item.described());
            Err(entry.refuse(item.line, why))
        };
        match (given, of, first) {
            (Some(given), Some(of), _) if given != of => return wrong(of),
            (Some(given), None, Some(first)) if given != first => {
                return wrong(&format!("{first} as the first in its list"));
            }
            _ => {}
        }
    }
    Ok(())
}

/// The value of a parameter in `item`. An empty list has no type in ROS 2.
fn read(attributes: &Attributes<'_>, item: &Item) -> Result<ParameterValue, LaunchError> {
    let Content::List(items) = &item.content else {
        return Ok(ParameterValue::Scalar(written(attributes, item)?));
    };
    if items.is_empty() {
        let why = "value: an empty list has no type for ROS 2, leave the parameter out";
        return Err(attributes.refuse(item.line, why));
    }
    let items: Result<_, _> = items.iter().map(|item| written(attributes, item)).collect();
    Ok(ParameterValue::List(items?))
}

fn written(attributes: &Attributes<'_>, item: &Item) -> Result<Written, LaunchError> {
    let text = attributes.scalar("value", item, &SCALARS)?;
    let kind = match item.content {
        Content::Scalar(_, kind) if text.template.as_plain().is_some() => Some(kind),
        _ => None,
    };
    Ok((text, kind))
}
