//! [`Decoder`]: a serde deserializer that reads CDR of either byte order.

use serde::de::{DeserializeSeed, Deserializer, SeqAccess, Visitor};
use serde::forward_to_deserialize_any;

use super::{ByteOrder, CdrError, ENCAPSULATION};

type Result<T> = std::result::Result<T, CdrError>;

/// A whole message, and the position of the next unread byte.
pub(crate) struct Decoder<'b> {
    bytes: &'b [u8],
    at: usize,
    order: ByteOrder,
}

impl<'b> Decoder<'b> {
    pub(crate) fn new(bytes: &'b [u8]) -> Result<Self> {
        let order = match bytes {
            [0, 0, _, _, ..] => ByteOrder::Big,
            [0, 1, _, _, ..] => ByteOrder::Little,
            [a, b, _, _, ..] => {
                return Err(CdrError::Value {
                    offset: 0,
                    expected: "encapsulation 00 00 (CDR_BE) or 00 01 (CDR_LE)",
                    got: format!("{a:02x} {b:02x}"),
                });
            }
            _ => {
                return Err(CdrError::Short { offset: 0, expected: ENCAPSULATION.len(), got: bytes.len() });
            }
        };
        Ok(Self { bytes, at: ENCAPSULATION.len(), order })
    }

    fn left(&self) -> usize {
        self.bytes.len().saturating_sub(self.at)
    }

    fn take(&mut self, length: usize) -> Result<&'b [u8]> {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let short = CdrError::Short { offset: self.at, expected: length, got: rest.len() };
        let taken = rest.get(..length).ok_or(short)?;
        self.at += length;
        Ok(taken)
    }

    /// Takes the next primitive and returns it in little-endian order, for either byte order of the message.
    fn number<const N: usize>(&mut self) -> Result<[u8; N]> {
        // XCDR1 aligns a primitive to its size, up to 8 bytes. The alignment counts from the end of the encapsulation.
        let body = self.at - ENCAPSULATION.len();
        self.at = body.next_multiple_of(N) + ENCAPSULATION.len();
        let mut value = [0; N];
        value.copy_from_slice(self.take(N)?);
        if let ByteOrder::Big = self.order {
            value.reverse();
        }
        Ok(value)
    }

    /// Takes the length of a sequence.
    fn length(&mut self) -> Result<usize> {
        let length = u32::from_le_bytes(self.number()?) as usize;
        // Each element has at least one byte. A length beyond the rest is damage, and must not decide how much memory
        // the visitor allocates.
        if length > self.left() {
            return Err(CdrError::Short { offset: self.at, expected: length, got: self.left() });
        }
        Ok(length)
    }

    fn byte_sequence(&mut self) -> Result<&'b [u8]> {
        let length = self.length()?;
        self.take(length)
    }

    /// Takes a string: its length with the closing NUL, the text, the NUL. Length 0, which some writers send, is read
    /// as an empty string.
    fn string(&mut self) -> Result<&'b str> {
        let offset = self.at;
        let value = |expected, got| CdrError::Value { offset, expected, got };
        let text = match self.byte_sequence()? {
            [] => &[],
            [text @ .., 0] => text,
            [.., last] => return Err(value("a string that ends with NUL", format!("{last:#04x}"))),
        };
        std::str::from_utf8(text).map_err(|error| value("UTF-8 text", error.to_string()))
    }
}

/// Defines methods that read one number each.
macro_rules! numbers {
    ($($method:ident: $number:ident $visit:ident),+) => {
        $(fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
            visitor.$visit($number::from_le_bytes(self.number()?))
        })+
    };
}

impl<'de> Deserializer<'de> for &mut Decoder<'de> {
    type Error = CdrError;

    numbers! {
        deserialize_i8: i8 visit_i8, deserialize_i16: i16 visit_i16,
        deserialize_i32: i32 visit_i32, deserialize_i64: i64 visit_i64,
        deserialize_u8: u8 visit_u8, deserialize_u16: u16 visit_u16,
        deserialize_u32: u32 visit_u32, deserialize_u64: u64 visit_u64,
        deserialize_f32: f32 visit_f32, deserialize_f64: f64 visit_f64
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
        let offset = self.at;
        match self.number()? {
            [0] => visitor.visit_bool(false),
            [1] => visitor.visit_bool(true),
            [other] => Err(CdrError::Value { offset, expected: "a bool, 0 or 1", got: other.to_string() }),
        }
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
        visitor.visit_borrowed_str(self.string()?)
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
        self.deserialize_str(visitor)
    }

    fn deserialize_bytes<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
        visitor.visit_borrowed_bytes(self.byte_sequence()?)
    }

    fn deserialize_byte_buf<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
        self.deserialize_bytes(visitor)
    }

    fn deserialize_unit_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value> {
        // ROS gives a message without fields one byte, see `serialize_unit_struct` of the encoder.
        self.take(1)?;
        visitor.visit_unit()
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
        // A sequence has a length on the wire, an array and a struct have none: their length is that of the Rust type.
        let left = self.length()?;
        visitor.visit_seq(Elements { decoder: self, left })
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, left: usize, visitor: V) -> Result<V::Value> {
        visitor.visit_seq(Elements { decoder: self, left })
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value> {
        self.deserialize_tuple(fields.len(), visitor)
    }

    /// Refuses: CDR does not describe its content, so only a known type can be read.
    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value> {
        Err(CdrError::Unsupported("an option, enum, map, char or value of any type"))
    }

    forward_to_deserialize_any! { char option unit tuple_struct map enum identifier ignored_any }

    fn is_human_readable(&self) -> bool {
        false
    }
}

/// The remaining elements of a sequence or an array, or the remaining fields of a struct.
struct Elements<'d, 'b> {
    decoder: &'d mut Decoder<'b>,
    left: usize,
}

impl<'de> SeqAccess<'de> for Elements<'_, 'de> {
    type Error = CdrError;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>> {
        if self.left == 0 {
            return Ok(None);
        }
        self.left -= 1;
        seed.deserialize(&mut *self.decoder).map(Some)
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.left)
    }
}
