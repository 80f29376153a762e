//! `~/get_type_description`: the service that describes the types of a node, as bytes of request and response.

use modulo_msgs::cdr::{self, CdrError};
use modulo_msgs::interface::definition;
use modulo_msgs::rihs::{type_description, type_hash};
use modulo_msgs::type_description_interfaces::{
    GetTypeDescriptionRequest, GetTypeDescriptionResponse, TypeDescription, TypeSource,
};

/// Name below the node's, and ROS type.
pub const NAME_AND_TYPE: (&str, &str) =
    ("get_type_description", "type_description_interfaces/srv/GetTypeDescription");

/// Answers one request. An unknown type or another hash is an answer, too.
///
/// # Errors
/// [`CdrError`] when the request cannot be read.
pub fn answer(request: &[u8]) -> Result<Vec<u8>, CdrError> {
    let asked: GetTypeDescriptionRequest = cdr::from_slice(request)?;
    let failed = |why: String| GetTypeDescriptionResponse { failure_reason: why, ..Default::default() };
    let name = &asked.type_name;
    let response = match (type_description(name), type_hash(name)) {
        // An empty hash asks for whatever version the node has.
        (Some(_), Some(known)) if !asked.type_hash.is_empty() && asked.type_hash != known => {
            failed(format!("{name} is known here with the hash {known}, not {}", asked.type_hash))
        }
        (Some(description), _) => GetTypeDescriptionResponse {
            successful: true,
            type_sources: if asked.include_type_sources { sources(&description) } else { Vec::new() },
            type_description: description,
            ..Default::default()
        },
        (None, _) => failed(format!("{name} is not a type of this node")),
    };
    cdr::to_vec(&response)
}

/// Returns the definitions' texts of a type and of all that it needs.
fn sources(description: &TypeDescription) -> Vec<TypeSource> {
    let referenced = description.referenced_type_descriptions.iter().map(|t| &t.type_name);
    std::iter::once(&description.type_description.type_name)
        .chain(referenced)
        .filter_map(|name| {
            // The encodings that ROS 2 names for the text files of messages and services.
            let encoding = if name.contains("/srv/") { "srv" } else { "msg" };
            let raw_file_contents = definition(name)?.to_owned();
            Some(TypeSource { type_name: name.clone(), encoding: encoding.to_owned(), raw_file_contents })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(type_name: &str, type_hash: &str, include_type_sources: bool) -> GetTypeDescriptionResponse {
        let (type_name, type_hash) = (type_name.to_owned(), type_hash.to_owned());
        let request = GetTypeDescriptionRequest { type_name, type_hash, include_type_sources };
        cdr::from_slice(&answer(&cdr::to_vec(&request).expect("short")).expect("readable"))
            .expect("a response")
    }

    #[test]
    fn a_known_type_is_described_with_all_that_it_needs() {
        let image = "sensor_msgs/msg/Image";
        let answer = ask(image, &type_hash(image).expect("known"), true);
        assert!(answer.successful, "{}", answer.failure_reason);
        let names: Vec<_> = answer.type_sources.iter().map(|s| s.type_name.as_str()).collect();
        assert_eq!(names, [image, "builtin_interfaces/msg/Time", "std_msgs/msg/Header"]);
        assert!(ask(image, "", false).type_sources.is_empty());
    }

    #[test]
    fn what_is_not_known_is_said() {
        let other = ask("sensor_msgs/msg/Image", "RIHS01_00", false);
        assert!(!other.successful && other.failure_reason.contains("RIHS01_00"), "{other:?}");
        let unknown = ask("a/msg/B", "", false);
        assert!(!unknown.successful && unknown.failure_reason.contains("a/msg/B"), "{unknown:?}");
    }
}
