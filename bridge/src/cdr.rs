//! Classic CDR (XCDR1, as ROS 2 uses it) for serde types, bounded by the bytes at hand.
//!
//! A payload begins with four bytes of encapsulation; numbers are aligned to their own size, counted
//! from behind it. Both byte orders are read, little endian is written. What a length field claims
//! is checked against the bytes that are left before anything is allocated, so a hostile payload
//! costs no more memory than it brought. Source: OMG DDSI-RTPS 2.5 §10, OMG CORBA 3.4 part 2 §9.3.

mod de;
mod ser;

use serde::Serialize;
use serde::de::DeserializeOwned;

/// What is wrong with a payload, and where.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CdrError {
    /// The payload ends inside a value.
    #[error(
        "payload ends at byte {len}: expected {wanted} more byte(s) of {what} at offset {offset}"
    )]
    Truncated {
        /// What was being read.
        what: &'static str,
        /// Where, in bytes from the start of the payload.
        offset: usize,
        /// Bytes missing.
        wanted: usize,
        /// Length of the payload.
        len: usize,
    },
    /// A length field claims more than the payload can hold.
    #[error(
        "{what} at offset {offset} claims {claimed} elements, but only {left} byte(s) are left"
    )]
    LengthBeyondPayload {
        /// What was being read.
        what: &'static str,
        /// Where the length field is.
        offset: usize,
        /// What it claims.
        claimed: u32,
        /// Bytes behind it.
        left: usize,
    },
    /// A value that its type does not have.
    #[error("bad {what} at offset {offset}: {found}")]
    BadValue {
        /// What was being read.
        what: &'static str,
        /// Where.
        offset: usize,
        /// What was found there.
        found: String,
    },
    /// Bytes are left behind the message.
    #[error("{left} byte(s) are left behind the message, which ends at offset {offset}")]
    TrailingBytes {
        /// Where the message ends.
        offset: usize,
        /// Bytes behind it.
        left: usize,
    },
    /// The Rust type has no form in CDR.
    #[error("not expressible in CDR: {what}")]
    Unsupported {
        /// Which type or value.
        what: String,
    },
}

/// Encodes a message, encapsulation included.
///
/// # Errors
/// [`CdrError::Unsupported`] for types without a form in CDR (maps, options, 128-bit integers) and
/// for strings with a NUL inside.
pub fn to_vec<T: Serialize>(message: &T) -> Result<Vec<u8>, CdrError> {
    ser::to_vec(message)
}

/// Decodes a message from a whole payload.
///
/// Up to 15 zero bytes behind the message are taken for padding: some writers fill each message up to a
/// multiple of 4, 8 or 16 bytes.
///
/// # Errors
/// [`CdrError`] says what was expected at which offset.
pub fn from_slice<T: DeserializeOwned>(payload: &[u8]) -> Result<T, CdrError> {
    de::from_slice(payload)
}

/// Decodes what a payload begins with, for example the header of a message whose rest is not needed.
///
/// # Errors
/// As [`from_slice`], but for what is behind.
pub(crate) fn beginning_of<T: DeserializeOwned>(payload: &[u8]) -> Result<T, CdrError> {
    de::beginning_of(payload)
}

#[cfg(test)]
mod tests;
