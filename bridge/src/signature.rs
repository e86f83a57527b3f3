//! Signing weights and checking them before use.
//!
//! Weights carry a BLAKE3 digest of their safetensors and an Ed25519 signature over a canonical form
//! of everything else: a line that names this use, then the message in CDR with the signature and
//! the safetensors left empty. The digest is part of it, so the signature covers all fields.

use std::io::{ErrorKind, Read};
use std::path::Path;

use ed25519_dalek::{Signature, Signer};
pub use ed25519_dalek::{SigningKey, VerifyingKey};

use crate::Error;
use crate::atomic_file::{self, Access};
use crate::cdr;
use crate::msg::swath::Weights;

/// Most bytes of safetensors that are looked at.
pub const MOST_WEIGHTS_BYTES: usize = 64 * 1024 * 1024;
/// Keeps a signature from being taken for one of something else.
const PURPOSE: &[u8] = b"swath weights v1\n";

/// The BLAKE3 digest of a file, in hexadecimal digits.
pub fn digest(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// Sets digest, public key and signature.
///
/// # Errors
/// [`Error::BadWeights`] if they are larger than [`MOST_WEIGHTS_BYTES`] or have a NUL in a name.
pub fn sign(weights: &mut Weights, key: &SigningKey) -> Result<(), Error> {
    check_size(weights)?;
    weights.digest = *blake3::hash(&weights.safetensors).as_bytes();
    weights.public_key = key.verifying_key().to_bytes().to_vec();
    weights.signature = key.sign(&signed_bytes(weights)?).to_bytes().to_vec();
    Ok(())
}

/// Checks that weights are what one of the trusted keys signed; without any, what some key signed.
///
/// # Errors
/// [`Error::BadWeights`] says what does not match.
pub fn verify(weights: &Weights, trusted: &[VerifyingKey]) -> Result<(), Error> {
    check_size(weights)?;
    let key = weights
        .public_key
        .first_chunk()
        .filter(|_| weights.public_key.len() == 32)
        .ok_or_else(|| {
            let len = weights.public_key.len();
            bad(weights, format!("a public key of {len} bytes, expected 32"))
        })?;
    let key = VerifyingKey::from_bytes(key)
        .map_err(|error| bad(weights, format!("not a public key: {error}")))?;
    if !trusted.is_empty() && !trusted.contains(&key) {
        let name = blake3::Hash::from_bytes(key.to_bytes()).to_hex();
        return Err(bad(
            weights,
            format!("signed by {name}, which is not trusted"),
        ));
    }
    let signature = Signature::from_slice(&weights.signature)
        .map_err(|error| bad(weights, format!("not a signature: {error}")))?;
    // The digest first: it is what the signature vouches for.
    if blake3::hash(&weights.safetensors) != weights.digest {
        return Err(bad(
            weights,
            "the safetensors do not match their digest".to_owned(),
        ));
    }
    key.verify_strict(&signed_bytes(weights)?, &signature)
        .map_err(|error| bad(weights, format!("the signature does not match: {error}")))
}

/// Reads the key in a file, or makes one and keeps it there, readable by its owner alone.
///
/// The file holds the 32 bytes of the secret key in hexadecimal digits, and a line end.
///
/// # Errors
/// [`Error::BadFile`] if the file holds something else, [`Error::Io`] if it cannot be read or
/// written, [`Error::NoRandomness`] if the system has none.
pub fn load_or_create_key(path: &Path) -> Result<SigningKey, Error> {
    match std::fs::File::open(path) {
        Ok(file) => read_key(path, file),
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let mut secret = [0; 32];
            if let Err(error) = getrandom::fill(&mut secret) {
                return Err(Error::NoRandomness {
                    path: path.to_owned(),
                    what: error.to_string(),
                });
            }
            let text = format!("{}\n", blake3::Hash::from_bytes(secret).to_hex());
            atomic_file::write(path, text.as_bytes(), Access::Owner)?;
            Ok(SigningKey::from_bytes(&secret))
        }
        Err(source) => Err(Error::Io {
            path: path.to_owned(),
            source,
        }),
    }
}

fn read_key(path: &Path, file: std::fs::File) -> Result<SigningKey, Error> {
    /// The digits and a line end of two bytes; more than that is something else.
    const MOST_BYTES: u64 = 66;
    let mut text = String::new();
    let read = file.take(MOST_BYTES + 1).read_to_string(&mut text);
    let digits = blake3::Hash::from_hex(text.trim_end());
    match (read, digits) {
        (Ok(_), Ok(secret)) => Ok(SigningKey::from_bytes(secret.as_bytes())),
        _ => Err(Error::BadFile {
            path: path.to_owned(),
            what: "not a key, expected 64 hexadecimal digits".to_owned(),
        }),
    }
}

fn check_size(weights: &Weights) -> Result<(), Error> {
    let len = weights.safetensors.len();
    if len > MOST_WEIGHTS_BYTES {
        let what = format!("{len} bytes of safetensors, expected at most {MOST_WEIGHTS_BYTES}");
        return Err(bad(weights, what));
    }
    Ok(())
}

fn bad(weights: &Weights, what: String) -> Error {
    Error::BadWeights {
        run: weights.run.clone(),
        version: weights.version,
        what,
    }
}

fn signed_bytes(weights: &Weights) -> Result<Vec<u8>, Error> {
    let unsigned = Weights {
        header: weights.header.clone(),
        run: weights.run.clone(),
        architecture: weights.architecture.clone(),
        vehicle: weights.vehicle.clone(),
        public_key: weights.public_key.clone(),
        signature: Vec::new(),
        safetensors: Vec::new(),
        ..*weights
    };
    let encoded = cdr::to_vec(&unsigned)
        .map_err(|error| bad(weights, format!("cannot be encoded: {error}")))?;
    Ok([PURPOSE, &encoded].concat())
}
