//! The writing half: a serde serializer that appends little-endian CDR to a buffer.

use serde::ser::{self, Serialize};

use super::CdrError;

/// Encapsulation of little-endian classic CDR.
const LITTLE_ENDIAN: [u8; 4] = [0, 1, 0, 0];

pub(super) fn to_vec<T: Serialize>(message: &T) -> Result<Vec<u8>, CdrError> {
    let mut writer = Writer {
        bytes: Vec::with_capacity(256),
    };
    writer.bytes.extend_from_slice(&LITTLE_ENDIAN);
    message.serialize(&mut writer)?;
    Ok(writer.bytes)
}

#[derive(Debug)]
struct Writer {
    bytes: Vec<u8>,
}

impl Writer {
    /// Appends a number of `N` bytes, a power of two, behind what its alignment needs.
    #[inline]
    fn put<const N: usize>(&mut self, bytes: [u8; N]) {
        let padding = (self.bytes.len() - LITTLE_ENDIAN.len()).wrapping_neg() & (N - 1);
        if padding > 0 {
            self.bytes.extend_from_slice(&[0; 8][..padding]);
        }
        self.bytes.extend_from_slice(&bytes);
    }

    fn put_len(&mut self, len: usize) -> Result<(), CdrError> {
        let len = u32::try_from(len).map_err(|_too_long| CdrError::Unsupported {
            what: format!("a sequence of {len} elements"),
        })?;
        self.put(len.to_le_bytes());
        Ok(())
    }
}

fn unsupported<T>(what: &str) -> Result<T, CdrError> {
    Err(CdrError::Unsupported {
        what: what.to_owned(),
    })
}

impl ser::Error for CdrError {
    fn custom<T: std::fmt::Display>(message: T) -> Self {
        Self::Unsupported {
            what: message.to_string(),
        }
    }
}

macro_rules! put_number {
    ($($method:ident: $type:ty),* $(,)?) => {
        $(#[inline]
        fn $method(self, value: $type) -> Result<(), CdrError> {
            self.put(value.to_le_bytes());
            Ok(())
        })*
    };
}

impl ser::Serializer for &mut Writer {
    type Ok = ();
    type Error = CdrError;
    type SerializeSeq = Self;
    type SerializeTuple = Self;
    type SerializeTupleStruct = Self;
    type SerializeTupleVariant = ser::Impossible<(), CdrError>;
    type SerializeMap = ser::Impossible<(), CdrError>;
    type SerializeStruct = Self;
    type SerializeStructVariant = ser::Impossible<(), CdrError>;

    put_number! {
        serialize_i8: i8, serialize_i16: i16, serialize_i32: i32, serialize_i64: i64,
        serialize_u8: u8, serialize_u16: u16, serialize_u32: u32, serialize_u64: u64,
        serialize_f32: f32, serialize_f64: f64,
    }

    fn serialize_bool(self, value: bool) -> Result<(), CdrError> {
        self.put([u8::from(value)]);
        Ok(())
    }

    fn serialize_char(self, _value: char) -> Result<(), CdrError> {
        unsupported("char")
    }

    fn serialize_str(self, value: &str) -> Result<(), CdrError> {
        if value.as_bytes().contains(&0) {
            return unsupported("a string with a NUL inside");
        }
        self.put_len(value.len() + 1)?;
        self.bytes.extend_from_slice(value.as_bytes());
        self.bytes.push(0);
        Ok(())
    }

    fn serialize_bytes(self, value: &[u8]) -> Result<(), CdrError> {
        self.put_len(value.len())?;
        self.bytes.extend_from_slice(value);
        Ok(())
    }

    fn serialize_none(self) -> Result<(), CdrError> {
        unsupported("Option")
    }

    fn serialize_some<T: ?Sized + Serialize>(self, _value: &T) -> Result<(), CdrError> {
        unsupported("Option")
    }

    fn serialize_unit(self) -> Result<(), CdrError> {
        unsupported("unit")
    }

    fn serialize_unit_struct(self, _name: &'static str) -> Result<(), CdrError> {
        unsupported("unit struct")
    }

    fn serialize_unit_variant(
        self,
        _name: &'static str,
        _index: u32,
        _variant: &'static str,
    ) -> Result<(), CdrError> {
        unsupported("enum")
    }

    fn serialize_newtype_struct<T: ?Sized + Serialize>(
        self,
        _name: &'static str,
        value: &T,
    ) -> Result<(), CdrError> {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: ?Sized + Serialize>(
        self,
        _name: &'static str,
        _index: u32,
        _variant: &'static str,
        _value: &T,
    ) -> Result<(), CdrError> {
        unsupported("enum")
    }

    fn serialize_seq(self, len: Option<usize>) -> Result<Self, CdrError> {
        let Some(len) = len else {
            return unsupported("a sequence of unknown length");
        };
        self.put_len(len)?;
        Ok(self)
    }

    fn serialize_tuple(self, _len: usize) -> Result<Self, CdrError> {
        Ok(self)
    }

    fn serialize_tuple_struct(self, _name: &'static str, _len: usize) -> Result<Self, CdrError> {
        Ok(self)
    }

    fn serialize_tuple_variant(
        self,
        _name: &'static str,
        _index: u32,
        _variant: &'static str,
        _len: usize,
    ) -> Result<Self::SerializeTupleVariant, CdrError> {
        unsupported("enum")
    }

    fn serialize_map(self, _len: Option<usize>) -> Result<Self::SerializeMap, CdrError> {
        unsupported("map")
    }

    fn serialize_struct(self, _name: &'static str, _len: usize) -> Result<Self, CdrError> {
        Ok(self)
    }

    fn serialize_struct_variant(
        self,
        _name: &'static str,
        _index: u32,
        _variant: &'static str,
        _len: usize,
    ) -> Result<Self::SerializeStructVariant, CdrError> {
        unsupported("enum")
    }

    fn is_human_readable(&self) -> bool {
        false
    }
}

macro_rules! append_parts {
    ($($trait:ident: $method:ident),* $(,)?) => {
        $(impl ser::$trait for &mut Writer {
            type Ok = ();
            type Error = CdrError;

            fn $method<T: ?Sized + Serialize>(&mut self, value: &T) -> Result<(), CdrError> {
                value.serialize(&mut **self)
            }

            fn end(self) -> Result<(), CdrError> {
                Ok(())
            }
        })*
    };
}

append_parts! {
    SerializeSeq: serialize_element,
    SerializeTuple: serialize_element,
    SerializeTupleStruct: serialize_field,
}

impl ser::SerializeStruct for &mut Writer {
    type Ok = ();
    type Error = CdrError;

    fn serialize_field<T: ?Sized + Serialize>(
        &mut self,
        _key: &'static str,
        value: &T,
    ) -> Result<(), CdrError> {
        value.serialize(&mut **self)
    }

    fn end(self) -> Result<(), CdrError> {
        Ok(())
    }
}
