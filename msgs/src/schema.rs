//! Definitions as bags and wire keys carry them: `ros2msg` text and DDS names.

use std::collections::BTreeMap;

use crate::definition::{DefinitionError, full_name, parse_fields};
use crate::interface;
use crate::type_description_interfaces::IndividualTypeDescription;

/// Characters `=` in the line between two definitions.
const SEPARATOR: usize = 80;

/// Returns the text of a message followed by those of all messages it needs, each after a line of 80 `=` and a line
/// `MSG: pkg/msg/Name`. `None` for a service, and for a message that the suite does not define.
pub fn ros2msg(name: &str) -> Option<String> {
    if name.contains("/srv/") {
        return None;
    }
    let mut text = interface::definition(name)?.to_owned();
    let mut listed = vec![name.to_owned()];
    let mut next = 0;
    while let Some(current) = listed.get(next) {
        for field in interface::describe(current).ok()??.fields {
            let needed = field.r#type.nested_type_name;
            if !needed.is_empty() && !listed.contains(&needed) {
                let definition = interface::definition(&needed)?;
                text += &format!("\n{}\nMSG: {needed}\n{definition}", "=".repeat(SEPARATOR));
                listed.push(needed);
            }
        }
        next += 1;
    }
    Some(text)
}

/// Returns the type's name on the wire: `sensor_msgs::msg::dds_::Image_`.
pub fn dds_name(name: &str) -> String {
    let (path, last) = name.rsplit_once('/').unwrap_or(("", name));
    path.split('/').filter(|part| !part.is_empty()).map(|part| format!("{part}::")).collect::<String>()
        + &format!("dds_::{last}_")
}

/// Returns the ROS name of a type on the wire; the inverse of [`dds_name`].
pub fn ros_name(dds: &str) -> String {
    let parts: Vec<&str> = dds.split("::").filter(|part| *part != "dds_").collect();
    let name = parts.join("/");
    name.strip_suffix('_').unwrap_or(&name).to_owned()
}

/// Returns all types in `ros2msg` text, of which the first is `name`.
pub(crate) fn parse(
    name: &str,
    text: &str,
) -> Result<BTreeMap<String, IndividualTypeDescription>, DefinitionError> {
    let mut sections = vec![(name.to_owned(), String::new())];
    let mut titled = true;
    for line in text.lines().map(str::trim) {
        match (titled, line.strip_prefix("MSG:")) {
            _ if line.len() == SEPARATOR && line.bytes().all(|b| b == b'=') => titled = false,
            (false, Some(title)) => {
                let line_is_bad = || DefinitionError::Line(name.to_owned(), line.to_owned());
                sections.push((full_name("", title.trim()).ok_or_else(line_is_bad)?, String::new()));
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
