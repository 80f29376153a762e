//! The text of values and descriptors of parameters, as `ros2 param get`, `describe` and `dump` write it. The
//! parameters may belong to any node, and may have types that the suite does not use.

use modulo_msgs::rcl_interfaces::{ParameterDescriptor, ParameterValue};

use crate::parameter::Value;
use crate::parameter::value::{TYPES, Yaml, from_ros};
use crate::parameter::yaml_text::of_double;

/// Returns the value with its type, as `ros2 param get` prints it: `Double value is: 4.0`.
pub fn labelled(value: &ParameterValue) -> String {
    let Some((_, _, kind)) = TYPES.iter().find(|(known, ..)| *known == value.r#type) else {
        return "Parameter not set.".to_owned();
    };
    let is_list = from_ros(value.clone()).is_some_and(|value| matches!(value.yaml(), Yaml::List(_)));
    format!("{kind} {}: {}", if is_list { "values are" } else { "value is" }, bare(value))
}

/// Returns the value without its type in Python's notation, as `ros2 param get --hide-type` prints it.
pub fn bare(value: &ParameterValue) -> String {
    // `ros2 param` prints the values as Python writes them.
    let python = |text: &String| match text.as_str() {
        "true" => "True".to_owned(),
        "false" => "False".to_owned(),
        number => number.to_owned(),
    };
    let list = |items: Vec<String>| format!("[{}]", items.join(", "));
    match from_ros(value.clone()) {
        None => "None".to_owned(),
        Some(Value::String(text)) => text,
        Some(Value::Strings(items)) => {
            list(items.iter().map(|item| format!("'{}'", item.replace('\'', "\\'"))).collect())
        }
        Some(other) => match other.yaml() {
            Yaml::Scalar(text) => python(&text),
            Yaml::List(items) => list(items.iter().map(python).collect()),
        },
    }
}

/// Returns the name of a type by its code in messages, as `ros2 param` prints it.
pub fn type_name(code: u8) -> &'static str {
    TYPES.iter().find(|(known, ..)| *known == code).map_or("not set", |(_, name, _)| name)
}

/// Returns the description of a parameter as `ros2 param describe` prints it.
pub fn described(descriptor: &ParameterDescriptor) -> String {
    let mut lines = vec![
        format!("Parameter name: {}", descriptor.name),
        format!("  Type: {}", type_name(descriptor.r#type)),
    ];
    if !descriptor.description.is_empty() {
        lines.push(format!("  Description: {}", descriptor.description));
    }
    lines.push("  Constraints:".to_owned());
    if descriptor.read_only {
        lines.push("    Read only: true".to_owned());
    }
    let doubles = descriptor.floating_point_range.first();
    let doubles = doubles.map(|r| [r.from_value, r.to_value, r.step].map(of_double));
    let integers = descriptor.integer_range.first();
    let integers = integers.map(|r| [r.from_value.to_string(), r.to_value.to_string(), r.step.to_string()]);
    if let Some([from, to, step]) = doubles.or(integers) {
        lines.extend([format!("    Min value: {from}"), format!("    Max value: {to}")]);
        // A step of 0 means every value of the range, and `ros2 param` prints none.
        if !matches!(step.as_str(), "0" | "0.0") {
            lines.push(format!("    Step: {step}"));
        }
    }
    if !descriptor.additional_constraints.is_empty() {
        lines.push(format!("    Additional constraints: {}", descriptor.additional_constraints));
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameter::to_ros;
    use modulo_msgs::rcl_interfaces::{FloatingPointRange, ParameterType};

    #[test]
    fn values_look_as_ros2_param_get_prints_them() {
        for (value, shown) in [
            (Value::Bool(true), "Boolean value is: True"),
            (Value::Integer(8), "Integer value is: 8"),
            (Value::Double(4.0), "Double value is: 4.0"),
            (Value::String("recovered".into()), "String value is: recovered"),
            (Value::Strings(vec!["a".into(), "b c".into()]), "String values are: ['a', 'b c']"),
        ] {
            assert_eq!(labelled(&to_ros(Some(&value))), shown);
        }
        assert_eq!(labelled(&to_ros(None)), "Parameter not set.");
        let bools = ParameterValue {
            r#type: ParameterType::PARAMETER_BOOL_ARRAY,
            bool_array_value: vec![true, false],
            ..ParameterValue::default()
        };
        assert_eq!(labelled(&bools), "Boolean values are: [True, False]");
    }

    #[test]
    fn descriptors_look_as_ros2_param_describe_prints_them() {
        let descriptor = ParameterDescriptor {
            name: "angle".into(),
            r#type: ParameterType::PARAMETER_DOUBLE,
            description: "an angle".into(),
            read_only: true,
            floating_point_range: vec![FloatingPointRange { from_value: 0.1, to_value: 256.0, step: 0.0 }],
            ..ParameterDescriptor::default()
        };
        let expected = "Parameter name: angle\n  Type: double\n  Description: an angle\n  Constraints:\n    \
                        Read only: true\n    Min value: 0.1\n    Max value: 256.0";
        assert_eq!(described(&descriptor), expected);
    }
}
