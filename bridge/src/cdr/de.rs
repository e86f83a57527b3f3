//! The reading half: a serde deserializer over a payload that trusts no length field.

use serde::de::{self, DeserializeOwned, DeserializeSeed, Visitor};

use super::CdrError;

/// Bytes of encapsulation before the message.
const ENCAPSULATION_BYTES: usize = 4;
/// Zero bytes behind a message that are taken for padding.
const MOST_PADDING_BYTES: usize = 15;

pub(super) fn from_slice<T: DeserializeOwned>(payload: &[u8]) -> Result<T, CdrError> {
    let mut reader = Reader::new(payload)?;
    let message = T::deserialize(&mut reader)?;
    let rest = &payload[reader.offset..];
    if rest.len() > MOST_PADDING_BYTES || rest.iter().any(|&byte| byte != 0) {
        return Err(CdrError::TrailingBytes {
            offset: reader.offset,
            left: rest.len(),
        });
    }
    Ok(message)
}

pub(super) fn beginning_of<T: DeserializeOwned>(payload: &[u8]) -> Result<T, CdrError> {
    T::deserialize(&mut Reader::new(payload)?)
}

/// What kind of data an encapsulation announces that is not read, and what to do about it. Source: OMG
/// DDS-XTypes 1.3 §7.6.3.1.2.
const fn kind_of(encapsulation: [u8; 2]) -> Option<&'static str> {
    Some(match encapsulation {
        [0, 2] => "parameter list CDR, big endian",
        [0, 3] => "parameter list CDR, little endian",
        [0, 4] => "XML",
        [0, 6] => "XCDR2, big endian",
        [0, 7] => "XCDR2, little endian",
        [0, 8] => "delimited XCDR2, big endian",
        [0, 9] => "delimited XCDR2, little endian",
        [0, 10] => "parameter list XCDR2, big endian",
        [0, 11] => "parameter list XCDR2, little endian",
        _ => return None,
    })
}

fn other_encapsulation(found: [u8; 2]) -> CdrError {
    let [a, b] = found;
    let what = match kind_of(found) {
        Some(kind) => format!(
            "{a:02x} {b:02x} ({kind}), expected 00 00 or 00 01 (CDR, also called XCDR1): let the sender \
             write XCDR1, or convert the recording"
        ),
        None => format!("{a:02x} {b:02x}, expected 00 00 or 00 01"),
    };
    CdrError::BadValue {
        what: "encapsulation",
        offset: 0,
        found: what,
    }
}

#[derive(Debug)]
struct Reader<'de> {
    payload: &'de [u8],
    offset: usize,
    big_endian: bool,
}

impl<'de> Reader<'de> {
    fn new(payload: &'de [u8]) -> Result<Self, CdrError> {
        let Some(head) = payload.first_chunk::<ENCAPSULATION_BYTES>() else {
            return Err(CdrError::Truncated {
                what: "encapsulation",
                offset: 0,
                wanted: ENCAPSULATION_BYTES - payload.len(),
                len: payload.len(),
            });
        };
        let big_endian = match [head[0], head[1]] {
            [0, 0] => true,
            [0, 1] => false,
            found => return Err(other_encapsulation(found)),
        };
        Ok(Self {
            payload,
            offset: ENCAPSULATION_BYTES,
            big_endian,
        })
    }

    fn take(&mut self, count: usize, what: &'static str) -> Result<&'de [u8], CdrError> {
        let found = self.payload[self.offset..].split_at_checked(count);
        let Some((bytes, _)) = found else {
            return Err(self.truncated(count, what));
        };
        self.offset += count;
        Ok(bytes)
    }

    /// Bytes of a number of `N` bytes, a power of two, in little-endian order.
    #[inline]
    fn number<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N], CdrError> {
        let padding = (self.offset - ENCAPSULATION_BYTES).wrapping_neg() & (N - 1);
        let found = self.payload.get(self.offset + padding..);
        let Some(&(mut bytes)) = found.and_then(<[u8]>::first_chunk::<N>) else {
            return Err(self.truncated(padding + N, what));
        };
        self.offset += padding + N;
        if self.big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    #[cold]
    fn truncated(&self, count: usize, what: &'static str) -> CdrError {
        CdrError::Truncated {
            what,
            offset: self.offset,
            wanted: count - (self.payload.len() - self.offset),
            len: self.payload.len(),
        }
    }

    /// Reads a length. Every element takes at least one byte, so more cannot be meant.
    fn length(&mut self, what: &'static str) -> Result<usize, CdrError> {
        let claimed = u32::from_le_bytes(self.number(what)?);
        let left = self.payload.len() - self.offset;
        match usize::try_from(claimed) {
            Ok(len) if len <= left => Ok(len),
            _ => Err(CdrError::LengthBeyondPayload {
                what,
                offset: self.offset - 4,
                claimed,
                left,
            }),
        }
    }

    fn string(&mut self) -> Result<&'de str, CdrError> {
        let len = self.length("string")?;
        let offset = self.offset;
        let bad = |found: String| CdrError::BadValue {
            what: "string",
            offset,
            found,
        };
        let bytes = self.take(len, "string")?;
        let text = match bytes {
            // Some writers leave out the terminator of an empty string.
            [] => bytes,
            [text @ .., 0] => text,
            _ => return Err(bad("no terminating NUL".to_owned())),
        };
        std::str::from_utf8(text)
            .map_err(|error| bad(format!("not UTF-8 behind byte {}", error.valid_up_to())))
    }
}

fn unsupported<T>(what: &str) -> Result<T, CdrError> {
    Err(CdrError::Unsupported {
        what: what.to_owned(),
    })
}

impl de::Error for CdrError {
    fn custom<T: std::fmt::Display>(message: T) -> Self {
        Self::Unsupported {
            what: message.to_string(),
        }
    }
}

macro_rules! read_number {
    ($($method:ident, $visit:ident: $type:ty),* $(,)?) => {
        $(#[inline]
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, CdrError> {
            let bytes = self.number(stringify!($type))?;
            visitor.$visit(<$type>::from_le_bytes(bytes))
        })*
    };
}

macro_rules! not_in_cdr {
    ($($method:ident: $what:literal),* $(,)?) => {
        $(fn $method<V: Visitor<'de>>(self, _visitor: V) -> Result<V::Value, CdrError> {
            unsupported($what)
        })*
    };
}

impl<'de> de::Deserializer<'de> for &mut Reader<'de> {
    type Error = CdrError;

    read_number! {
        deserialize_i8, visit_i8: i8, deserialize_i16, visit_i16: i16,
        deserialize_i32, visit_i32: i32, deserialize_i64, visit_i64: i64,
        deserialize_u8, visit_u8: u8, deserialize_u16, visit_u16: u16,
        deserialize_u32, visit_u32: u32, deserialize_u64, visit_u64: u64,
        deserialize_f32, visit_f32: f32, deserialize_f64, visit_f64: f64,
    }

    not_in_cdr! {
        deserialize_any: "a self-describing type", deserialize_char: "char",
        deserialize_option: "Option", deserialize_unit: "unit", deserialize_map: "map",
        deserialize_identifier: "identifier", deserialize_ignored_any: "ignored value",
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, CdrError> {
        match self.take(1, "bool")?[0] {
            0 => visitor.visit_bool(false),
            1 => visitor.visit_bool(true),
            other => Err(CdrError::BadValue {
                what: "bool",
                offset: self.offset - 1,
                found: format!("{other}, expected 0 or 1"),
            }),
        }
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, CdrError> {
        visitor.visit_borrowed_str(self.string()?)
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, CdrError> {
        self.deserialize_str(visitor)
    }

    fn deserialize_bytes<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, CdrError> {
        let len = self.length("byte sequence")?;
        visitor.visit_borrowed_bytes(self.take(len, "byte sequence")?)
    }

    fn deserialize_byte_buf<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, CdrError> {
        self.deserialize_bytes(visitor)
    }

    fn deserialize_unit_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _visitor: V,
    ) -> Result<V::Value, CdrError> {
        unsupported("unit struct")
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        visitor: V,
    ) -> Result<V::Value, CdrError> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, CdrError> {
        let left = self.length("sequence")?;
        visitor.visit_seq(Parts { reader: self, left })
    }

    fn deserialize_tuple<V: Visitor<'de>>(
        self,
        len: usize,
        visitor: V,
    ) -> Result<V::Value, CdrError> {
        visitor.visit_seq(Parts {
            reader: self,
            left: len,
        })
    }

    fn deserialize_tuple_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        len: usize,
        visitor: V,
    ) -> Result<V::Value, CdrError> {
        self.deserialize_tuple(len, visitor)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, CdrError> {
        self.deserialize_tuple(fields.len(), visitor)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _variants: &'static [&'static str],
        _visitor: V,
    ) -> Result<V::Value, CdrError> {
        unsupported("enum")
    }

    fn is_human_readable(&self) -> bool {
        false
    }
}

/// The elements of a sequence or the fields of a struct that are still to be read.
struct Parts<'a, 'de> {
    reader: &'a mut Reader<'de>,
    left: usize,
}

impl<'de> de::SeqAccess<'de> for Parts<'_, 'de> {
    type Error = CdrError;

    #[inline]
    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, CdrError> {
        if self.left == 0 {
            return Ok(None);
        }
        self.left -= 1;
        seed.deserialize(&mut *self.reader).map(Some)
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.left)
    }
}
