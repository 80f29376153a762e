//! The requests and responses of services: one module for each ROS package. The services of parameters are in
//! [`rcl_interfaces`](crate::rcl_interfaces).

/// `std_srvs`: requests and responses of the three standard services.
pub mod std_srvs {
    messages! {
        EmptyRequest = "std_srvs/srv/Empty_Request"
        EmptyResponse = "std_srvs/srv/Empty_Response"
        SetBoolRequest = "std_srvs/srv/SetBool_Request" {
            data: bool,
        }
        SetBoolResponse = "std_srvs/srv/SetBool_Response" {
            success: bool,
            /// A message for a person, such as the reason for a failure.
            message: String,
        }
        TriggerRequest = "std_srvs/srv/Trigger_Request"
        TriggerResponse = "std_srvs/srv/Trigger_Response" {
            success: bool,
            /// A message for a person, such as the reason for a failure.
            message: String,
        }
    }
}

/// `service_msgs`: the common fields of all service events.
pub mod service_msgs {
    use crate::builtin::Time;

    messages! {
        ServiceEventInfo = "service_msgs/msg/ServiceEventInfo" {
            /// 0: a client has sent a request; 1: a server has received it, and 2: has sent a response; 3: the client has received that.
            event_type: u8,
            stamp: Time,
            /// Global id of the client.
            client_gid: [u8; 16],
            /// Number of the call at the client, from 1.
            sequence_number: i64,
        }
    }
}

/// `rosbag2_interfaces`: the services that control a running player, as in ROS 2 Jazzy.
pub mod rosbag2_interfaces {
    use crate::builtin::{Duration, Time};

    messages! {
        PauseRequest = "rosbag2_interfaces/srv/Pause_Request"
        PauseResponse = "rosbag2_interfaces/srv/Pause_Response"
        ResumeRequest = "rosbag2_interfaces/srv/Resume_Request"
        ResumeResponse = "rosbag2_interfaces/srv/Resume_Response"
        TogglePausedRequest = "rosbag2_interfaces/srv/TogglePaused_Request"
        TogglePausedResponse = "rosbag2_interfaces/srv/TogglePaused_Response"
        IsPausedRequest = "rosbag2_interfaces/srv/IsPaused_Request"
        IsPausedResponse = "rosbag2_interfaces/srv/IsPaused_Response" {
            /// Whether the player is paused.
            paused: bool,
        }
        SetRateRequest = "rosbag2_interfaces/srv/SetRate_Request" {
            /// Speed, finite and above 0; 2 is twice as fast as the recording.
            rate: f64,
        }
        SetRateResponse = "rosbag2_interfaces/srv/SetRate_Response" {
            /// Whether the rate is possible.
            success: bool,
        }
        GetRateRequest = "rosbag2_interfaces/srv/GetRate_Request"
        GetRateResponse = "rosbag2_interfaces/srv/GetRate_Response" {
            /// Speed; 2 is twice as fast as the recording.
            rate: f64,
        }
        PlayRequest = "rosbag2_interfaces/srv/Play_Request" {
            /// Bag time that is left out at the start.
            start_offset: Time,
            /// Bag time to play; negative for all of it.
            playback_duration: Duration,
            /// Time in the bag at which the playback ends; negative for the end of the bag.
            playback_until_timestamp: Time,
        }
        PlayResponse = "rosbag2_interfaces/srv/Play_Response" {
            /// Whether a playback was started; false while another one runs.
            success: bool,
        }
        StopRequest = "rosbag2_interfaces/srv/Stop_Request"
        StopResponse = "rosbag2_interfaces/srv/Stop_Response"
        PlayNextRequest = "rosbag2_interfaces/srv/PlayNext_Request"
        PlayNextResponse = "rosbag2_interfaces/srv/PlayNext_Response" {
            /// Whether a message was played, which is only possible while the player is paused.
            success: bool,
        }
        BurstRequest = "rosbag2_interfaces/srv/Burst_Request" {
            /// Number of messages to play at once; 0 plays all remaining messages.
            num_messages: u64,
        }
        BurstResponse = "rosbag2_interfaces/srv/Burst_Response" {
            /// Number of messages that were played; 0 when the player is not paused.
            actually_burst: u64,
        }
        SeekRequest = "rosbag2_interfaces/srv/Seek_Request" {
            /// Time in the bag at which the player continues.
            time: Time,
        }
        SeekResponse = "rosbag2_interfaces/srv/Seek_Response" {
            /// Whether the bag contains that time.
            success: bool,
        }
    }
}

/// `type_description_interfaces`: descriptions of types as messages. The hash of a type is computed over its
/// [`TypeDescription`](type_description_interfaces::TypeDescription).
pub mod type_description_interfaces {
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
            name: String,
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
            type_description: IndividualTypeDescription,
            /// All types that it uses directly or indirectly, sorted by name.
            referenced_type_descriptions: Vec<IndividualTypeDescription>,
        }
        TypeSource = "type_description_interfaces/msg/TypeSource" {
            /// Name of the type, such as `sensor_msgs/msg/Image`.
            type_name: String,
            /// Form of the definition, such as `msg` or `srv`.
            encoding: String,
            raw_file_contents: String,
        }
        KeyValue = "type_description_interfaces/msg/KeyValue" {
            key: String,
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
            failure_reason: String,
            type_description: TypeDescription,
            /// The texts of the definitions, if they were requested.
            type_sources: Vec<TypeSource>,
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
}
