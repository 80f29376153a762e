//! `type_description_interfaces`: types described in types. The type hash is
//! taken over a [`TypeDescription`].

use serde::{Deserialize, Serialize};

use crate::interface::interfaces;

/// `type_description_interfaces/msg/FieldType`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FieldType {
    /// 1 nested, 2 to 22 primitive; +48 array, +96 bounded, +144 unbounded sequence.
    pub type_id: u8,
    /// Length of an array, bound of a sequence; else 0.
    pub capacity: u64,
    /// Bound of a string; else 0.
    pub string_capacity: u64,
    /// Full name of a nested type; else empty.
    pub nested_type_name: String,
}

impl FieldType {
    /// `type_id` of a message type.
    pub const NESTED: u8 = 1;
    /// Added to `type_id` for an array of `capacity` elements.
    pub const ARRAY: u8 = 48;
    /// Added to `type_id` for a sequence of at most `capacity` elements.
    pub const BOUNDED_SEQUENCE: u8 = 96;
    /// Added to `type_id` for a sequence of any length.
    pub const UNBOUNDED_SEQUENCE: u8 = 144;
}

/// `type_description_interfaces/msg/Field`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Field {
    /// The field's name.
    pub name: String,
    /// The field's type.
    pub r#type: FieldType,
    /// As the definition writes it; empty: none.
    pub default_value: String,
}

/// `type_description_interfaces/msg/IndividualTypeDescription`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct IndividualTypeDescription {
    /// Such as `sensor_msgs/msg/Image`.
    pub type_name: String,
    /// In order of the definition.
    pub fields: Vec<Field>,
}

/// `type_description_interfaces/msg/TypeDescription`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TypeDescription {
    /// The type itself.
    pub type_description: IndividualTypeDescription,
    /// All types it needs, directly or not, sorted by name.
    pub referenced_type_descriptions: Vec<IndividualTypeDescription>,
}

/// `type_description_interfaces/msg/TypeSource`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TypeSource {
    /// Such as `sensor_msgs/msg/Image`.
    pub type_name: String,
    /// Such as `msg` or `srv`.
    pub encoding: String,
    /// The definition's text.
    pub raw_file_contents: String,
}

/// `type_description_interfaces/msg/KeyValue`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeyValue {
    /// What.
    pub key: String,
    /// Its value.
    pub value: String,
}

/// `type_description_interfaces/srv/GetTypeDescription_Request`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetTypeDescriptionRequest {
    /// Such as `sensor_msgs/msg/Image`.
    pub type_name: String,
    /// `RIHS01_` and 64 hexadecimal digits.
    pub type_hash: String,
    /// Whether the definitions' texts are wanted too.
    pub include_type_sources: bool,
}

/// `type_description_interfaces/srv/GetTypeDescription_Response`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetTypeDescriptionResponse {
    /// Whether the type is known.
    pub successful: bool,
    /// Why not.
    pub failure_reason: String,
    /// The type.
    pub type_description: TypeDescription,
    /// The definitions' texts, if asked for.
    pub type_sources: Vec<TypeSource>,
    /// Whatever else the node says.
    pub extra_information: Vec<KeyValue>,
}

interfaces! {
    FieldType = "type_description_interfaces/msg/FieldType",
    Field = "type_description_interfaces/msg/Field",
    IndividualTypeDescription = "type_description_interfaces/msg/IndividualTypeDescription",
    TypeDescription = "type_description_interfaces/msg/TypeDescription",
    TypeSource = "type_description_interfaces/msg/TypeSource",
    KeyValue = "type_description_interfaces/msg/KeyValue",
    GetTypeDescriptionRequest = "type_description_interfaces/srv/GetTypeDescription_Request",
    GetTypeDescriptionResponse = "type_description_interfaces/srv/GetTypeDescription_Response",
}
