//! What the messages here are called in ROS, and how ROS defines them.
//!
//! The definitions are embedded; nothing is read from an installation.

mod texts;

use crate::definition::{DefinitionError, parse_fields};
use crate::type_description_interfaces::{Field, FieldType, IndividualTypeDescription};

/// A message with a ROS name.
pub trait Interface {
    /// Such as `sensor_msgs/msg/Image` or `std_srvs/srv/SetBool_Request`.
    const NAME: &'static str;
}

/// Names the messages of one ROS package.
macro_rules! interfaces {
    ($($message:ident = $name:literal),+ $(,)?) => {
        $(impl $crate::interface::Interface for $message {
            const NAME: &'static str = $name;
        })+
    };
}
pub(crate) use interfaces;

/// The `.msg` or `.srv` text of a message or service of the suite, such as
/// `sensor_msgs/msg/Image` or `std_srvs/srv/SetBool`.
pub fn definition(name: &str) -> Option<&'static str> {
    texts::DEFINITIONS.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// The names that [`definition`] knows.
pub fn names() -> impl Iterator<Item = &'static str> {
    texts::DEFINITIONS.iter().map(|(name, _)| *name)
}

/// The fields of a message, a service, or a service's request, response or
/// event. `None` when the suite does not define it.
pub(crate) fn describe(name: &str) -> Result<Option<IndividualTypeDescription>, DefinitionError> {
    let fields = match (definition(name), name.contains("/srv/")) {
        (Some(_), true) => service(name),
        (Some(text), false) => parse_fields(name, text)?,
        (None, true) => match service_part(name)? {
            Some(fields) => fields,
            None => return Ok(None),
        },
        (None, false) => return Ok(None),
    };
    Ok(Some(IndividualTypeDescription { type_name: name.to_owned(), fields }))
}

/// The three members that stand for a service.
fn service(name: &str) -> Vec<Field> {
    ["request", "response", "event"]
        .map(|part| {
            let suffix = part[..1].to_ascii_uppercase() + &part[1..];
            nested(&format!("{part}_message"), &format!("{name}_{suffix}"), FieldType::NESTED)
        })
        .into()
}

fn service_part(name: &str) -> Result<Option<Vec<Field>>, DefinitionError> {
    let Some((service, part)) = name.rsplit_once('_') else { return Ok(None) };
    let Some(text) = definition(service) else { return Ok(None) };
    let (request, response) = text.split_once("---\n").unwrap_or((text, ""));
    Ok(match part {
        "Request" => Some(parse_fields(name, request)?),
        "Response" => Some(parse_fields(name, response)?),
        "Event" => Some(event(service)),
        _ => None,
    })
}

/// What a service introspection event holds: request and response are
/// sequences of at most one.
fn event(service: &str) -> Vec<Field> {
    let at_most_one = FieldType::NESTED + FieldType::BOUNDED_SEQUENCE;
    vec![
        nested("info", "service_msgs/msg/ServiceEventInfo", FieldType::NESTED),
        nested("request", &format!("{service}_Request"), at_most_one),
        nested("response", &format!("{service}_Response"), at_most_one),
    ]
}

fn nested(name: &str, type_name: &str, type_id: u8) -> Field {
    let capacity = u64::from(type_id != FieldType::NESTED);
    let nested_type_name = type_name.to_owned();
    let r#type = FieldType { type_id, capacity, string_capacity: 0, nested_type_name };
    Field { name: name.to_owned(), r#type, default_value: String::new() }
}
