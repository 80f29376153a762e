//! The names of the messages in ROS and on the wire, and their definitions, also in the form in which bags carry them.
//!
//! The definitions are embedded in the program; no ROS installation is read.

use std::collections::BTreeMap;

use crate::definition::{DefinitionError, full_name, parse_fields};
use crate::type_description_interfaces::{Field, FieldType, IndividualTypeDescription, TypeSource};

/// (name, text) of every message and service, without comments.
static DEFINITIONS: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/definitions.rs"));

/// Returns the `.msg` or `.srv` text of a message or service of the suite, such as `sensor_msgs/msg/Image` or
/// `std_srvs/srv/SetBool`.
pub fn definition(name: &str) -> Option<&'static str> {
    DEFINITIONS.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// Lists the names that [`definition`] knows.
pub fn names() -> impl Iterator<Item = &'static str> {
    DEFINITIONS.iter().map(|(name, _)| *name)
}

/// Returns the fields of a message, of a service, or of the request, response or event of a service; `None` when the
/// suite does not define the type.
pub(crate) fn describe(name: &str) -> Option<IndividualTypeDescription> {
    let fields = match definition(name) {
        // A service is a type with a hash of its own: a message that contains its request, response and event.
        Some(_) if name.contains("/srv/") => service(name),
        Some(text) => own_fields(name, text),
        None => service_message(name)?,
    };
    Some(IndividualTypeDescription { type_name: name.to_owned(), fields })
}

fn own_fields(name: &str, text: &str) -> Vec<Field> {
    parse_fields(name, text).expect("the tests read each definition of the suite")
}

/// Returns the three fields that describe a service.
fn service(name: &str) -> Vec<Field> {
    ["request", "response", "event"]
        .map(|part| {
            let suffix = part[..1].to_ascii_uppercase() + &part[1..];
            nested(&format!("{part}_message"), &format!("{name}_{suffix}"), FieldType::NESTED)
        })
        .into()
}

fn service_message(name: &str) -> Option<Vec<Field>> {
    // The last underscore: the name of a service itself may contain some.
    let (service, part) = name.rsplit_once('_').filter(|_| name.contains("/srv/"))?;
    let text = definition(service)?;
    let (request, response) = text.split_once("---\n").unwrap_or((text, ""));
    match part {
        "Request" => Some(own_fields(name, request)),
        "Response" => Some(own_fields(name, response)),
        "Event" => Some(event(service)),
        _ => None,
    }
}

/// Returns the fields of a service introspection event; request and response are sequences of at most one element.
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

/// Characters `=` in the line between two definitions.
const SEPARATOR: usize = 80;

/// Returns the text of a message followed by those of all messages it needs, each after a line of 80 `=` and a line
/// `MSG: pkg/msg/Name`. `None` for a service, and for a message that the suite does not define.
pub fn ros2msg(name: &str) -> Option<String> {
    if name.contains("/srv/") {
        return None;
    }
    let mut text = definition(name)?.to_owned();
    // `listed` grows while it is read, so that the needs of the needed types follow. Each type is added once, even if
    // several messages contain it.
    let mut listed = vec![name.to_owned()];
    let mut next = 0;
    while let Some(current) = listed.get(next) {
        for field in describe(current)?.fields {
            let needed = field.r#type.nested_type_name;
            if !needed.is_empty() && !listed.contains(&needed) {
                let definition = definition(&needed)?;
                text += &section(&needed, definition);
                listed.push(needed);
            }
        }
        next += 1;
    }
    Some(text)
}

/// Returns the text that [`ros2msg`] would return, made of the sources that a node has sent. `None` when the source of `name`
/// is not among them, or one of them is no `.msg` text.
pub fn ros2msg_of(name: &str, sources: &[TypeSource]) -> Option<String> {
    let own = sources.iter().find(|source| source.type_name == name)?;
    let needed = sources.iter().filter(|source| source.type_name != name);
    let needed = needed.map(|source| section(&source.type_name, &source.raw_file_contents));
    let readable = sources.iter().all(|source| source.encoding == "msg");
    readable.then(|| own.raw_file_contents.clone() + &needed.collect::<String>())
}

/// Returns the definition of a type that another one needs, with the lines that separate them.
fn section(name: &str, definition: &str) -> String {
    format!("\n{}\nMSG: {name}\n{definition}", "=".repeat(SEPARATOR))
}

/// Returns the type's name on the wire: `sensor_msgs::msg::dds_::Image_`.
pub fn dds_name(name: &str) -> String {
    let (path, last) = name.rsplit_once('/').unwrap_or(("", name));
    path.split('/').filter(|part| !part.is_empty()).map(|part| format!("{part}::")).collect::<String>()
        + &format!("dds_::{last}_")
}

/// Returns the ROS name of a type on the wire; the inverse of [`dds_name`].
pub fn ros_name(dds: &str) -> String {
    // Only the last underscore belongs to DDS: `SetBool_Request_` stands for `SetBool_Request`.
    let parts: Vec<&str> = dds.split("::").filter(|part| *part != "dds_").collect();
    let name = parts.join("/");
    name.strip_suffix('_').unwrap_or(&name).to_owned()
}

/// Returns all types in `ros2msg` text, of which the first is `name`.
pub(crate) fn parse_schema(
    name: &str,
    text: &str,
) -> Result<BTreeMap<String, IndividualTypeDescription>, DefinitionError> {
    let mut sections = vec![(name.to_owned(), String::new())];
    // A line of 80 `=` ends a definition. The line `MSG: pkg/Name` after it names the next one; without this line the
    // text belongs to the definition before. Lines are trimmed, because a foreign text may end them with CRLF.
    let mut titled = true;
    for line in text.lines().map(str::trim) {
        match (titled, line.strip_prefix("MSG:")) {
            _ if line.len() == SEPARATOR && line.bytes().all(|b| b == b'=') => titled = false,
            (false, Some(title)) => {
                let title = full_name("", title.trim()).ok_or_else(|| DefinitionError::line(name, line))?;
                sections.push((title, String::new()));
                titled = true;
            }
            _ => {
                if let Some((_, body)) = sections.last_mut() {
                    body.push_str(line);
                    body.push('\n');
                }
            }
        }
    }
    sections
        .into_iter()
        .map(|(type_name, body)| {
            let fields = parse_fields(&type_name, &body)?;
            Ok((type_name.clone(), IndividualTypeDescription { type_name, fields }))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_on_the_wire() {
        assert_eq!(dds_name("sensor_msgs/msg/Image"), "sensor_msgs::msg::dds_::Image_");
        assert_eq!(dds_name("std_srvs/srv/SetBool"), "std_srvs::srv::dds_::SetBool_");
        assert_eq!(ros_name("std_srvs::srv::dds_::SetBool_"), "std_srvs/srv/SetBool");
    }

    #[test]
    fn a_schema_holds_each_dependency_once() {
        let text = ros2msg("vision_msgs/msg/Detection2DArray").expect("defined");
        let titles: Vec<_> = text.lines().filter_map(|line| line.strip_prefix("MSG: ")).collect();
        let mut once = titles.clone();
        once.sort_unstable();
        once.dedup();
        assert_eq!(titles.len(), once.len());
        assert_eq!(titles.len(), 12);
        assert_eq!(text.lines().filter(|line| *line == "=".repeat(80)).count(), 12);
    }

    #[test]
    fn services_and_strangers_have_no_schema() {
        assert_eq!(ros2msg("std_srvs/srv/SetBool"), None);
        assert_eq!(ros2msg("nav_msgs/msg/Path"), None);
    }
}
