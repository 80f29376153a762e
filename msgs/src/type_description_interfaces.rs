//! `type_description_interfaces`: descriptions of types as messages. The hash of a type is computed over its
//! [`TypeDescription`].

use crate::interface::messages;

messages! {
    FieldType = "type_description_interfaces/msg/FieldType" {
        /// Code of the type: 1 for a message, 2 to 22 for a primitive; plus 48 for an array, 96 for a bounded and 144
        /// for an unbounded sequence.
        type_id: u8,
        /// Length of an array or bound of a sequence; 0 for all other types.
        capacity: u64,
        /// Bound of a string; 0 for all other types.
        string_capacity: u64,
        /// Full name of a message type; empty for all other types.
        nested_type_name: String,
    }
    Field = "type_description_interfaces/msg/Field" {
        /// Name of the field.
        name: String,
        /// Type of the field.
        r#type: FieldType,
        /// Default value as the definition writes it; empty without a default.
        default_value: String,
    }
    IndividualTypeDescription = "type_description_interfaces/msg/IndividualTypeDescription" {
        /// Name of the type, such as `sensor_msgs/msg/Image`.
        type_name: String,
        /// Fields in the order of the definition.
        fields: Vec<Field>,
    }
    TypeDescription = "type_description_interfaces/msg/TypeDescription" {
        /// The type.
        type_description: IndividualTypeDescription,
        /// All types that it uses directly or indirectly, sorted by name.
        referenced_type_descriptions: Vec<IndividualTypeDescription>,
    }
    TypeSource = "type_description_interfaces/msg/TypeSource" {
        /// Name of the type, such as `sensor_msgs/msg/Image`.
        type_name: String,
        /// Form of the definition, such as `msg` or `srv`.
        encoding: String,
        /// Text of the definition.
        raw_file_contents: String,
    }
    KeyValue = "type_description_interfaces/msg/KeyValue" {
        /// Key.
        key: String,
        /// Value.
        value: String,
    }
    GetTypeDescriptionRequest = "type_description_interfaces/srv/GetTypeDescription_Request" {
        /// Name of the type, such as `sensor_msgs/msg/Image`.
        type_name: String,
        /// `RIHS01_` and 64 hexadecimal digits.
        type_hash: String,
        /// Whether the response is to contain the texts of the definitions.
        include_type_sources: bool,
    }
    GetTypeDescriptionResponse = "type_description_interfaces/srv/GetTypeDescription_Response" {
        /// Whether the node knows the type.
        successful: bool,
        /// The reason for a failure.
        failure_reason: String,
        /// The type.
        type_description: TypeDescription,
        /// The texts of the definitions, if they were requested.
        type_sources: Vec<TypeSource>,
        /// Further information about the type.
        extra_information: Vec<KeyValue>,
    }
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
