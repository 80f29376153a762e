//! `rcl_interfaces`: parameters with their six services, and log lines.

use crate::builtin::Time;

messages! {
    /// The codes of the field `type` of [`ParameterValue`].
    ParameterType = "rcl_interfaces/msg/ParameterType"
    /// The value of a parameter, in the field that `type` names.
    ParameterValue = "rcl_interfaces/msg/ParameterValue" {
        /// A code of [`ParameterType`].
        r#type: u8,
        bool_value: bool,
        integer_value: i64,
        double_value: f64,
        string_value: String,
        #[serde(with = "crate::cdr::bytes")]
        byte_array_value: Vec<u8>,
        bool_array_value: Vec<bool>,
        integer_array_value: Vec<i64>,
        double_array_value: Vec<f64>,
        string_array_value: Vec<String>,
    }
    Parameter = "rcl_interfaces/msg/Parameter" {
        name: String,
        value: ParameterValue,
    }
    /// The closed range from `from_value` to `to_value`.
    FloatingPointRange = "rcl_interfaces/msg/FloatingPointRange" {
        from_value: f64,
        to_value: f64,
        /// Distance between possible values; 0 allows every value of the range.
        step: f64,
    }
    /// The closed range from `from_value` to `to_value`.
    IntegerRange = "rcl_interfaces/msg/IntegerRange" {
        from_value: i64,
        to_value: i64,
        /// Distance between possible values; 0 allows every value of the range.
        step: u64,
    }
    ParameterDescriptor = "rcl_interfaces/msg/ParameterDescriptor" {
        name: String,
        /// A code of [`ParameterType`].
        r#type: u8,
        /// One sentence, with the unit.
        description: String,
        additional_constraints: String,
        /// Whether the value is fixed at the start of the node.
        read_only: bool,
        /// Whether the type may change.
        dynamic_typing: bool,
        /// At most one range.
        floating_point_range: Vec<FloatingPointRange>,
        /// At most one range.
        integer_range: Vec<IntegerRange>,
    }
    ParameterEvent = "rcl_interfaces/msg/ParameterEvent" {
        stamp: Time,
        /// Fully qualified name of the node.
        node: String,
        new_parameters: Vec<Parameter>,
        changed_parameters: Vec<Parameter>,
        deleted_parameters: Vec<Parameter>,
    }
    SetParametersResult = "rcl_interfaces/msg/SetParametersResult" {
        successful: bool,
        reason: String,
    }
    ListParametersResult = "rcl_interfaces/msg/ListParametersResult" {
        names: Vec<String>,
        prefixes: Vec<String>,
    }
    LoggerLevel = "rcl_interfaces/msg/LoggerLevel" {
        /// Name of the logger, such as `front.unwrap` for the node `/front/unwrap`.
        name: String,
        /// [`Log::DEBUG`], `INFO`, `WARN`, `ERROR` or `FATAL`; 0 is unknown.
        level: u32,
    }
    SetLoggerLevelsResult = "rcl_interfaces/msg/SetLoggerLevelsResult" {
        successful: bool,
        reason: String,
    }
    /// One line of `/rosout`.
    Log = "rcl_interfaces/msg/Log" {
        stamp: Time,
        /// [`Log::DEBUG`], `INFO`, `WARN`, `ERROR` or `FATAL`.
        level: u8,
        name: String,
        msg: String,
        file: String,
        function: String,
        line: u32,
    }
}

#[allow(missing_docs, reason = "the field of this name holds the value, such as `bool_value` for `BOOL`")]
impl ParameterType {
    /// The parameter is not set, or is being deleted.
    pub const NOT_SET: u8 = 0;
    pub const BOOL: u8 = 1;
    pub const INTEGER: u8 = 2;
    pub const DOUBLE: u8 = 3;
    pub const STRING: u8 = 4;
    pub const BYTE_ARRAY: u8 = 5;
    pub const BOOL_ARRAY: u8 = 6;
    pub const INTEGER_ARRAY: u8 = 7;
    pub const DOUBLE_ARRAY: u8 = 8;
    pub const STRING_ARRAY: u8 = 9;
}

impl Log {
    /// The line is only of interest to a developer.
    pub const DEBUG: u8 = 10;
    /// The line reports normal work.
    pub const INFO: u8 = 20;
    /// A person should look at the cause of the line.
    pub const WARN: u8 = 30;
    /// Something failed.
    pub const ERROR: u8 = 40;
    /// The node ends.
    pub const FATAL: u8 = 50;
}

messages! {
    DescribeParametersRequest = "rcl_interfaces/srv/DescribeParameters_Request" {
        names: Vec<String>,
    }
    DescribeParametersResponse = "rcl_interfaces/srv/DescribeParameters_Response" {
        /// The descriptors in the order of the request.
        descriptors: Vec<ParameterDescriptor>,
    }
    GetLoggerLevelsRequest = "rcl_interfaces/srv/GetLoggerLevels_Request" {
        names: Vec<String>,
    }
    GetLoggerLevelsResponse = "rcl_interfaces/srv/GetLoggerLevels_Response" {
        /// The levels in the order of the request.
        levels: Vec<LoggerLevel>,
    }
    SetLoggerLevelsRequest = "rcl_interfaces/srv/SetLoggerLevels_Request" {
        /// The levels; each one is accepted or refused separately.
        levels: Vec<LoggerLevel>,
    }
    SetLoggerLevelsResponse = "rcl_interfaces/srv/SetLoggerLevels_Response" {
        /// The results in the order of the request.
        results: Vec<SetLoggerLevelsResult>,
    }
    GetParameterTypesRequest = "rcl_interfaces/srv/GetParameterTypes_Request" {
        names: Vec<String>,
    }
    GetParameterTypesResponse = "rcl_interfaces/srv/GetParameterTypes_Response" {
        /// Codes of [`ParameterType`] in the order of the request.
        #[serde(with = "crate::cdr::bytes")]
        types: Vec<u8>,
    }
    GetParametersRequest = "rcl_interfaces/srv/GetParameters_Request" {
        names: Vec<String>,
    }
    GetParametersResponse = "rcl_interfaces/srv/GetParameters_Response" {
        /// The values in the order of the request.
        values: Vec<ParameterValue>,
    }
    ListParametersRequest = "rcl_interfaces/srv/ListParameters_Request" {
        /// Prefixes of the listed names; an empty list stands for all names.
        prefixes: Vec<String>,
        /// Largest depth below a prefix, in components of a name; 0 does not limit it.
        depth: u64,
    }
    ListParametersResponse = "rcl_interfaces/srv/ListParameters_Response" {
        result: ListParametersResult,
    }
    SetParametersRequest = "rcl_interfaces/srv/SetParameters_Request" {
        /// The parameters; each one is accepted or refused separately.
        parameters: Vec<Parameter>,
    }
    SetParametersResponse = "rcl_interfaces/srv/SetParameters_Response" {
        /// The results in the order of the request.
        results: Vec<SetParametersResult>,
    }
    SetParametersAtomicallyRequest = "rcl_interfaces/srv/SetParametersAtomically_Request" {
        /// The parameters; all of them are accepted, or all are refused.
        parameters: Vec<Parameter>,
    }
    SetParametersAtomicallyResponse = "rcl_interfaces/srv/SetParametersAtomically_Response" {
        /// The result of the whole request.
        result: SetParametersResult,
    }
}
