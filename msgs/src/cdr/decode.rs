//! [`Decoder`]: the deserializer of `re_cdr`, which compares each length with the remaining bytes.

use re_cdr::{ByteOrder, CdrDeserializer, Error, Result};
use serde::Deserialize;
use serde::de::{DeserializeSeed, Deserializer, SeqAccess, Visitor};
use serde::forward_to_deserialize_any;

/// The next unread byte of a message of `length` bytes without its encapsulation.
pub(crate) struct Decoder<'b, O> {
    bytes: CdrDeserializer<'b, O>,
    pub(crate) length: usize,
}

impl<'b, O: ByteOrder> Decoder<'b, O> {
    pub(crate) fn new(body: &'b [u8]) -> Self {
        Self { bytes: CdrDeserializer::new(body), length: body.len() }
    }

    /// Number of bytes that were read.
    pub(crate) fn at(&self) -> usize {
        self.bytes.bytes_consumed()
    }
}

/// Defines methods that read a value without elements.
macro_rules! single {
    ($($method:ident)+) => {
        $(fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
            self.bytes.$method(visitor)
        })+
    };
}

impl<'de, O: ByteOrder> Deserializer<'de> for &mut Decoder<'de, O> {
    type Error = Error;

    single! {
        deserialize_bool deserialize_i8 deserialize_i16 deserialize_i32 deserialize_i64 deserialize_u8 deserialize_u16
        deserialize_u32 deserialize_u64 deserialize_f32 deserialize_f64 deserialize_str deserialize_string
        deserialize_bytes deserialize_byte_buf deserialize_any
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value> {
        let length = u32::deserialize(&mut self.bytes)? as usize;
        let left = self.length - self.at();
        // Each element has at least one byte. A length beyond the rest is damage, and must not decide how much memory
        // the visitor allocates.
        if length > left {
            return Err(Error::Custom(format!("{length} elements expected, but only {left} bytes are left")));
        }
        self.deserialize_tuple(length, visitor)
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, left: usize, visitor: V) -> Result<V::Value> {
        // A sequence has a length on the wire, an array and a struct have none: their length is that of the Rust type.
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

    forward_to_deserialize_any! {
        char option unit unit_struct newtype_struct tuple_struct map enum identifier ignored_any
    }

    fn is_human_readable(&self) -> bool {
        false
    }
}

/// The remaining elements of a sequence or an array, or the remaining fields of a struct.
struct Elements<'d, 'b, O> {
    decoder: &'d mut Decoder<'b, O>,
    left: usize,
}

impl<'de, O: ByteOrder> SeqAccess<'de> for Elements<'_, 'de, O> {
    type Error = Error;

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
