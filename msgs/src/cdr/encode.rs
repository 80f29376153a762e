//! [`Encoder`]: a serde serializer that writes little-endian CDR.

use serde::Serialize;
use serde::ser::{Impossible, SerializeSeq, SerializeStruct, SerializeTuple, Serializer};

use super::{CdrError, ENCAPSULATION};

type Result<T> = std::result::Result<T, CdrError>;
type Never = Impossible<(), CdrError>;

/// The bytes written so far.
pub(crate) struct Encoder {
    out: Vec<u8>,
}

impl Encoder {
    pub(crate) fn new() -> Self {
        Self { out: ENCAPSULATION.to_vec() }
    }

    pub(crate) fn finish(self) -> Vec<u8> {
        self.out
    }

    /// Appends a primitive of `N` bytes after zero padding up to a multiple of `N`.
    fn put<const N: usize>(&mut self, value: [u8; N]) -> Result<()> {
        // The padding is zero, so that equal messages have equal bytes. ROS itself leaves old memory there.
        let body = self.out.len() - ENCAPSULATION.len();
        self.out.resize(self.out.len() + body.next_multiple_of(N) - body, 0);
        self.out.extend_from_slice(&value);
        Ok(())
    }

    fn put_length(&mut self, length: usize) -> Result<()> {
        let fits =
            u32::try_from(length).map_err(|_| CdrError::Long { offset: self.out.len(), got: length })?;
        self.put(fits.to_le_bytes())
    }
}

/// Defines methods that write one number each.
macro_rules! numbers {
    ($($method:ident: $number:ty),+) => {
        $(fn $method(self, value: $number) -> Result<()> {
            self.put(value.to_le_bytes())
        })+
    };
}

/// Defines methods for the types that a ROS message never contains.
macro_rules! unsupported {
    ($($method:ident($($argument:ty),*) -> $output:ty, $what:literal);+ $(;)?) => {
        $(fn $method(self, $(_: $argument),*) -> Result<$output> {
            Err(CdrError::Unsupported($what))
        })+
    };
}

impl<'e> Serializer for &'e mut Encoder {
    type Ok = ();
    type Error = CdrError;
    type SerializeSeq = &'e mut Encoder;
    type SerializeTuple = &'e mut Encoder;
    type SerializeStruct = &'e mut Encoder;
    type SerializeTupleStruct = Never;
    type SerializeTupleVariant = Never;
    type SerializeMap = Never;
    type SerializeStructVariant = Never;

    numbers! {
        serialize_i8: i8, serialize_i16: i16, serialize_i32: i32, serialize_i64: i64,
        serialize_u8: u8, serialize_u16: u16, serialize_u32: u32, serialize_u64: u64,
        serialize_f32: f32, serialize_f64: f64
    }

    unsupported! {
        serialize_char(char) -> (), "a char";
        serialize_none() -> (), "an option";
        serialize_unit() -> (), "nothing";
        serialize_unit_variant(&'static str, u32, &'static str) -> (), "an enum";
        serialize_tuple_struct(&'static str, usize) -> Never, "a tuple struct";
        serialize_tuple_variant(&'static str, u32, &'static str, usize) -> Never, "an enum";
        serialize_struct_variant(&'static str, u32, &'static str, usize) -> Never, "an enum";
        serialize_map(Option<usize>) -> Never, "a map";
    }

    fn serialize_bool(self, value: bool) -> Result<()> {
        self.put([u8::from(value)])
    }

    fn serialize_str(self, text: &str) -> Result<()> {
        // The length of a string includes its closing NUL.
        self.put_length(text.len().saturating_add(1))?;
        self.out.extend_from_slice(text.as_bytes());
        self.put([0])
    }

    fn serialize_bytes(self, bytes: &[u8]) -> Result<()> {
        self.put_length(bytes.len())?;
        self.out.extend_from_slice(bytes);
        Ok(())
    }

    /// Writes one byte: ROS gives a message without fields the field `structure_needs_at_least_one_member`.
    fn serialize_unit_struct(self, _: &'static str) -> Result<()> {
        self.put([0])
    }

    fn serialize_seq(self, length: Option<usize>) -> Result<Self> {
        // The length comes before the elements, so that it must be known.
        self.put_length(length.ok_or(CdrError::Unsupported("a sequence of unknown length"))?)?;
        Ok(self)
    }

    fn serialize_tuple(self, _: usize) -> Result<Self> {
        Ok(self)
    }

    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Self> {
        Ok(self)
    }

    fn serialize_some<T: Serialize + ?Sized>(self, _: &T) -> Result<()> {
        Err(CdrError::Unsupported("an option"))
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(self, _: &'static str, value: &T) -> Result<()> {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        _: &T,
    ) -> Result<()> {
        Err(CdrError::Unsupported("an enum"))
    }

    fn is_human_readable(&self) -> bool {
        false
    }
}

/// Implements a serde trait that writes elements one after the other.
macro_rules! elements {
    ($($compound:ident::$method:ident($($name:ty)?);)+) => {
        $(impl $compound for &mut Encoder {
            type Ok = ();
            type Error = CdrError;

            fn $method<T: Serialize + ?Sized>(&mut self, $(_: $name,)? value: &T) -> Result<()> {
                value.serialize(&mut **self)
            }

            fn end(self) -> Result<()> {
                Ok(())
            }
        })+
    };
}

elements! {
    SerializeSeq::serialize_element();
    SerializeTuple::serialize_element();
    SerializeStruct::serialize_field(&'static str);
}
