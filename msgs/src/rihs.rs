//! RIHS01, the hash that identifies a type in ROS 2: SHA-256 over the JSON of a type description without default values.
//!
//! Source: <https://github.com/ros-infrastructure/rep/pull/381> (REP 2011, 2016)

use std::collections::{BTreeMap, BTreeSet};
use std::sync::OnceLock;

use crate::definition::{DefinitionError, full_name};
use crate::interface;
use crate::type_description_interfaces::{Field, IndividualTypeDescription, TypeDescription};

/// `RIHS01_` and 64 hexadecimal digits for a message, a service, or a service's request, response or event. `None` when
/// the suite does not define it, or when the crate is built without the feature `hashes`.
///
/// ```
/// let hash = modulo_msgs::type_hash("sensor_msgs/msg/Image").expect("the suite defines it");
/// assert_eq!(hash, "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47");
/// ```
pub fn type_hash(name: &str) -> Option<String> {
    static HASHES: OnceLock<BTreeMap<String, String>> = OnceLock::new();
    HASHES.get_or_init(all_hashes).get(name).cloned()
}

/// Returns the hash of `name` as foreign `ros2msg` text defines it: the type's own fields, then each dependency after a
/// line of 80 `=` and a line `MSG: pkg/Name`.
///
/// # Errors
/// [`DefinitionError`] with the line that is no field, or the type that is missing; and without the feature `hashes`.
pub fn type_hash_of_schema(name: &str, text: &str) -> Result<String, DefinitionError> {
    hash(&description_of_schema(name, text)?)
}

/// Returns the description of `name` that foreign `ros2msg` text gives it. Messages can be read with it as they come: no
/// type in it contains itself.
///
/// # Errors
/// The errors of [`type_hash_of_schema`].
pub fn description_of_schema(name: &str, text: &str) -> Result<TypeDescription, DefinitionError> {
    let name = full_name("", name).ok_or_else(|| DefinitionError::missing(name))?;
    let types = interface::parse_schema(&name, text)?;
    gather(&name, |wanted| types.get(wanted).cloned())
}

/// Returns the whole description of a type that the suite defines, as `~/get_type_description` answers it.
pub fn type_description(name: &str) -> Option<TypeDescription> {
    gather(name, interface::describe).ok()
}

fn all_hashes() -> BTreeMap<String, String> {
    let parts = ["", "_Request", "_Response", "_Event"];
    interface::names()
        .flat_map(|name| parts.map(|part| format!("{name}{part}")))
        .filter_map(|name| hash(&type_description(&name)?).ok().map(|hash| (name, hash)))
        .collect()
}

/// The description of `name` and of all types that it needs, directly or indirectly.
fn gather(
    name: &str,
    find: impl Fn(&str) -> Option<IndividualTypeDescription>,
) -> Result<TypeDescription, DefinitionError> {
    let find = |name: &str| find(name).ok_or_else(|| DefinitionError::missing(name));
    let type_description = find(name)?;
    // REP 2016 sorts the referenced types by name, as this map does.
    let mut referenced = BTreeMap::new();
    // Types that are still to be described. A type can be needed several times, and a foreign definition can contain
    // itself: each type is visited once, so that the loop ends.
    let mut open = needs(&type_description);
    while let Some(next) = open.pop() {
        if next != name && !referenced.contains_key(&next) {
            let found = find(&next)?;
            open.extend(needs(&found));
            referenced.insert(next, found);
        }
    }
    let referenced_type_descriptions = referenced.into_values().collect();
    let description = TypeDescription { type_description, referenced_type_descriptions };
    if is_nested_flat(&description) {
        Ok(description)
    } else {
        Err(DefinitionError(format!("'{name}' contains itself, or is nested too deep; a ROS message cannot")))
    }
}

/// Levels of types within types that a reader follows.
const DEPTH: usize = 64;

/// Returns whether no type contains itself, or more than [`DEPTH`] levels of others.
fn is_nested_flat(description: &TypeDescription) -> bool {
    let own = std::iter::once(&description.type_description);
    let mut open: Vec<_> = own.chain(&description.referenced_type_descriptions).collect();
    // Each round takes out the types whose needs are out already: one level.
    for _ in 0..DEPTH {
        let names: BTreeSet<_> = open.iter().map(|inner| inner.type_name.clone()).collect();
        open.retain(|outer| needs(outer).iter().any(|need| names.contains(need)));
    }
    open.is_empty()
}

fn needs(description: &IndividualTypeDescription) -> Vec<String> {
    let nested = description.fields.iter().map(|field| &field.r#type.nested_type_name);
    nested.filter(|name| !name.is_empty()).cloned().collect()
}

fn hash(description: &TypeDescription) -> Result<String, DefinitionError> {
    // The hash is computed over text, so that the order of the keys and each space count: this is the form of
    // `json.dumps` of Python without newlines. serde_json would leave out the spaces.
    let referenced: Vec<_> = description.referenced_type_descriptions.iter().map(individual_json).collect();
    let json = format!(
        r#"{{"type_description": {}, "referenced_type_descriptions": [{}]}}"#,
        individual_json(&description.type_description),
        referenced.join(", "),
    );
    let no_hashes = || DefinitionError("this build has no hashes of types".to_owned());
    sha256(&json).map(|digits| format!("RIHS01_{digits}")).ok_or_else(no_hashes)
}

#[cfg(feature = "hashes")]
fn sha256(text: &str) -> Option<String> {
    use sha2::{Digest, Sha256};
    Some(Sha256::digest(text).iter().map(|byte| format!("{byte:02x}")).collect())
}

#[cfg(not(feature = "hashes"))]
fn sha256(_: &str) -> Option<String> {
    None
}

// `full_name` and `parse_line` accept only letters, digits, `_` and `/` in names, so that no name needs JSON escapes.
fn individual_json(description: &IndividualTypeDescription) -> String {
    let fields: Vec<_> = description.fields.iter().map(field_json).collect();
    format!(r#"{{"type_name": "{}", "fields": [{}]}}"#, description.type_name, fields.join(", "))
}

fn field_json(Field { name, r#type, .. }: &Field) -> String {
    format!(
        r#"{{"name": "{name}", "type": {{"type_id": {}, "capacity": {}, "string_capacity": {}, "nested_type_name": "{}"}}}}"#,
        r#type.type_id, r#type.capacity, r#type.string_capacity, r#type.nested_type_name,
    )
}
