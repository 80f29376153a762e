//! Messages whose type is known only when the program runs: CDR and a type description in, a tree of values out, shown
//! as `ros2 topic echo` shows it.
//!
//! Nothing is guessed: without the description there is no value.

use std::fmt;

use serde::Deserialize;
use serde::de::{DeserializeSeed, Deserializer, SeqAccess, Visitor};

use crate::cdr::{self, CdrError};
use crate::type_description_interfaces::{Field, FieldType, TypeDescription};

/// A value of any message type.
#[derive(Clone, Debug, PartialEq)]
pub enum Dynamic {
    /// `bool`
    Bool(bool),
    /// Any integer.
    Integer(i128),
    /// `float32`, `float64`
    Float(f64),
    /// `string`
    Text(String),
    /// `uint8[]`, `byte[]`
    Bytes(Vec<u8>),
    /// An array or a sequence of anything else.
    List(Vec<Dynamic>),
    /// A message, in order of its definition.
    Message(Vec<(String, Dynamic)>),
}

/// Reads `bytes` (CDR with its encapsulation) as a message of the described type.
///
/// # Errors
/// [`CdrError`] when the bytes are no such message, or the description needs a type that it lacks.
pub fn from_slice(description: &TypeDescription, bytes: &[u8]) -> Result<Dynamic, CdrError> {
    let fields = &description.type_description.fields;
    cdr::from_slice_seed(MessageSeed { fields, description }, bytes)
}

#[derive(Clone, Copy)]
struct MessageSeed<'t> {
    fields: &'t [Field],
    description: &'t TypeDescription,
}

#[derive(Clone, Copy)]
struct ValueSeed<'t> {
    r#type: &'t FieldType,
    description: &'t TypeDescription,
}

/// One element of an array or sequence, or a single value.
#[derive(Clone, Copy)]
struct ElementSeed<'t>(ValueSeed<'t>);

impl<'de> DeserializeSeed<'de> for MessageSeed<'_> {
    type Value = Dynamic;

    fn deserialize<D: Deserializer<'de>>(self, decoder: D) -> Result<Dynamic, D::Error> {
        if self.fields.is_empty() {
            // A description without fields stands for an empty message, which is one byte in CDR.
            return u8::deserialize(decoder).map(|_| Dynamic::Message(Vec::new()));
        }
        decoder.deserialize_tuple(self.fields.len(), self)
    }
}

impl<'de> Visitor<'de> for MessageSeed<'_> {
    type Value = Dynamic;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a message of {} fields", self.fields.len())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut values: A) -> Result<Dynamic, A::Error> {
        let mut message = Vec::with_capacity(self.fields.len());
        for field in self.fields {
            let value = ValueSeed { r#type: &field.r#type, description: self.description };
            // The decoder gives one element for each field that it was asked for, so that the loop never ends early.
            let Some(value) = values.next_element_seed(value)? else { break };
            message.push((field.name.clone(), value));
        }
        Ok(Dynamic::Message(message))
    }
}

impl<'de> DeserializeSeed<'de> for ValueSeed<'_> {
    type Value = Dynamic;

    fn deserialize<D: Deserializer<'de>>(self, decoder: D) -> Result<Dynamic, D::Error> {
        // A type code is that of the element plus 0, 48, 96 or 144 for a single value, an array, a bounded and an
        // unbounded sequence.
        let (one, many) = (self.r#type.type_id % 48, self.r#type.type_id / 48);
        let capacity = usize::try_from(self.r#type.capacity).unwrap_or(usize::MAX);
        match (many, one) {
            (0, _) => ElementSeed(self).deserialize(decoder),
            // Images are sequences of bytes: read one by one, each pixel would become a value of its own.
            (2 | 3, FieldType::UINT8 | FieldType::BYTE) => {
                cdr::bytes::deserialize(decoder).map(Dynamic::Bytes)
            }
            (1, _) => decoder.deserialize_tuple(capacity, ElementSeed(self)),
            _ => decoder.deserialize_seq(ElementSeed(self)),
        }
    }
}

impl<'de> Visitor<'de> for ElementSeed<'_> {
    type Value = Dynamic;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("elements of a sequence")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut values: A) -> Result<Dynamic, A::Error> {
        // No memory is reserved for the stated length: a damaged message could claim any length.
        let mut list = Vec::new();
        while let Some(value) = values.next_element_seed(self)? {
            list.push(value);
        }
        Ok(Dynamic::List(list))
    }
}

impl<'de> DeserializeSeed<'de> for ElementSeed<'_> {
    type Value = Dynamic;

    fn deserialize<D: Deserializer<'de>>(self, decoder: D) -> Result<Dynamic, D::Error> {
        let Self(ValueSeed { r#type, description }) = self;
        Ok(match r#type.type_id % 48 {
            FieldType::NESTED => {
                // A description lists all types that it needs in one level, so that nested types are looked up by name.
                let name = &r#type.nested_type_name;
                let nested = description.referenced_type_descriptions.iter().find(|t| t.type_name == *name);
                let missing = || serde::de::Error::custom(format!("type {name} is not described"));
                let fields = &nested.ok_or_else(missing)?.fields;
                MessageSeed { fields, description }.deserialize(decoder)?
            }
            2 => Dynamic::Integer(i8::deserialize(decoder)?.into()),
            FieldType::UINT8 | FieldType::BYTE => Dynamic::Integer(u8::deserialize(decoder)?.into()),
            4 => Dynamic::Integer(i16::deserialize(decoder)?.into()),
            5 => Dynamic::Integer(u16::deserialize(decoder)?.into()),
            6 => Dynamic::Integer(i32::deserialize(decoder)?.into()),
            7 => Dynamic::Integer(u32::deserialize(decoder)?.into()),
            8 => Dynamic::Integer(i64::deserialize(decoder)?.into()),
            9 => Dynamic::Integer(u64::deserialize(decoder)?.into()),
            10 => Dynamic::Float(f32::deserialize(decoder)?.into()),
            11 => Dynamic::Float(f64::deserialize(decoder)?),
            15 => Dynamic::Bool(bool::deserialize(decoder)?),
            17 | 21 => Dynamic::Text(String::deserialize(decoder)?),
            other => return Err(serde::de::Error::custom(format!("type id {other} cannot be shown"))),
        })
    }
}

/// Number of elements of an array that are shown; the remaining ones are counted.
const SHOWN: usize = 128;

/// Writes the value as YAML; long arrays are cut.
impl fmt::Display for Dynamic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write(f, 0)
    }
}

impl Dynamic {
    fn write(&self, f: &mut fmt::Formatter<'_>, depth: usize) -> fmt::Result {
        match self {
            Self::Message(fields) => {
                fields.iter().try_for_each(|(name, value)| value.write_field(f, name, depth))
            }
            value => writeln!(f, "{:1$}{2}", "", 2 * depth, Inline(value)),
        }
    }

    fn write_field(&self, f: &mut fmt::Formatter<'_>, name: &str, depth: usize) -> fmt::Result {
        let indent = 2 * depth;
        match self {
            Self::Message(fields) if !fields.is_empty() => {
                writeln!(f, "{:indent$}{name}:", "")?;
                self.write(f, depth + 1)
            }
            Self::List(items) if items.iter().any(|item| matches!(item, Self::Message(_))) => {
                writeln!(f, "{:indent$}{name}:", "")?;
                for item in items.iter().take(SHOWN) {
                    writeln!(f, "{:indent$}-", "")?;
                    item.write(f, depth + 1)?;
                }
                match items.len().saturating_sub(SHOWN) {
                    0 => Ok(()),
                    more => writeln!(f, "{:indent$}# and {more} more", ""),
                }
            }
            value => writeln!(f, "{:indent$}{name}: {}", "", Inline(value)),
        }
    }
}

/// A value on the line of its name.
struct Inline<'v>(&'v Dynamic);

impl fmt::Display for Inline<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Dynamic::Bool(value) => write!(f, "{value}"),
            Dynamic::Integer(value) => write!(f, "{value}"),
            Dynamic::Float(value) => write!(f, "{value:?}"),
            Dynamic::Text(text) => write!(f, "{text:?}"),
            Dynamic::Bytes(bytes) => write_list(f, bytes.iter(), bytes.len()),
            Dynamic::List(items) => write_list(f, items.iter().map(Inline), items.len()),
            Dynamic::Message(_) => f.write_str("{}"),
        }
    }
}

fn write_list<T: fmt::Display>(
    f: &mut fmt::Formatter<'_>,
    items: impl Iterator<Item = T>,
    length: usize,
) -> fmt::Result {
    f.write_str("[")?;
    for (index, item) in items.take(SHOWN).enumerate() {
        let comma = if index == 0 { "" } else { ", " };
        write!(f, "{comma}{item}")?;
    }
    if length > SHOWN {
        write!(f, ", '... {} more'", length - SHOWN)?;
    }
    f.write_str("]")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
    use crate::interface::names;
    use crate::rihs::type_description;
    use crate::std_msgs::{Header, Time};

    fn shown<T: serde::Serialize>(name: &str, message: &T) -> String {
        let bytes = cdr::to_vec(message).unwrap();
        from_slice(&type_description(name).unwrap(), &bytes).unwrap().to_string()
    }

    #[test]
    fn shows_what_was_written() {
        let values = vec![KeyValue { key: "method_used".into(), value: "lines".into() }];
        let status =
            DiagnosticStatus { level: 1, name: "unwrap".into(), values, ..DiagnosticStatus::default() };
        let header = Header { stamp: Time { sec: 7, nanosec: 5 }, frame_id: "front \"left\"".into() };
        let array = DiagnosticArray { header, status: vec![status] };
        let text = shown("diagnostic_msgs/msg/DiagnosticArray", &array);
        let expected = "header:\n  stamp:\n    sec: 7\n    nanosec: 5\n  frame_id: \"front \\\"left\\\"\"\nstatus:\n-\n  \
                        level: 1\n  name: \"unwrap\"\n  message: \"\"\n  hardware_id: \"\"\n  values:\n  -\n    \
                        key: \"method_used\"\n    value: \"lines\"\n";
        assert_eq!(text, expected);
    }

    #[test]
    fn long_arrays_are_cut_and_counted() {
        let image = crate::sensor_msgs::Image { data: vec![7; 1000], ..Default::default() };
        let text = shown("sensor_msgs/msg/Image", &image);
        assert!(text.contains("7, '... 872 more']") && text.len() < 1000, "{text}");
    }

    proptest! {
        #[test]
        fn no_length_is_believed(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let bytes = [&[0, 1, 0, 0], &bytes[..]].concat();
            for name in names().filter(|name| name.contains("/msg/")) {
                let description = type_description(name).unwrap();
                if let Ok(value) = from_slice(&description, &bytes) {
                    // Each byte is shown once, with the name of its field.
                    let shown = value.to_string();
                    prop_assert!(shown.len() < 1000 + 100 * bytes.len(), "{name}: {} bytes", shown.len());
                }
            }
        }
    }
}
