//! The messages: serde types whose field order is that of the `.msg` files under `msg/`.
//!
//! Everything on the wire, in a recording and out to ROS 2 is one of these in CDR.

mod schema;

pub mod geometry;
pub mod header;
pub mod nav;
pub mod sensor;

pub mod swath;
pub mod tf2;

use serde::Serialize;
use serde::de::DeserializeOwned;

pub use schema::{definition_of, schema_of};

/// A message type: a name and a definition for those outside, CDR on the wire.
pub trait Message: Serialize + DeserializeOwned + Send + Sync + 'static {
    /// Name as ROS 2 writes it, for example `nav_msgs/msg/Path`.
    const TYPE_NAME: &'static str;
}

/// Byte arrays that Rust holds as `Vec<i8>`, encoded in one piece.
mod signed_bytes {
    use serde::{Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(
        values: &[i8],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(bytemuck::cast_slice(values))
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vec<i8>, D::Error> {
        let bytes: Vec<u8> = serde_bytes::deserialize(deserializer)?;
        Ok(bytemuck::cast_vec(bytes))
    }
}

/// Arrays of a fixed length that serde has no implementation for.
mod fixed_array {
    use serde::de::{Error, SeqAccess, Visitor};
    use serde::ser::SerializeTuple;
    use serde::{Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer, const N: usize>(
        values: &[f64; N],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let mut tuple = serializer.serialize_tuple(N)?;
        for value in values {
            tuple.serialize_element(value)?;
        }
        tuple.end()
    }

    struct Array<const N: usize>;

    impl<'de, const N: usize> Visitor<'de> for Array<N> {
        type Value = [f64; N];

        fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            write!(formatter, "{N} numbers")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut parts: A) -> Result<Self::Value, A::Error> {
            let mut values = [0.0; N];
            for (index, value) in values.iter_mut().enumerate() {
                *value = parts
                    .next_element()?
                    .ok_or_else(|| A::Error::invalid_length(index, &self))?;
            }
            Ok(values)
        }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>, const N: usize>(
        deserializer: D,
    ) -> Result<[f64; N], D::Error> {
        deserializer.deserialize_tuple(N, Array::<N>)
    }
}
