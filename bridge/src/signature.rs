//! Signing weights and checking them before use.
//!
//! Weights carry a BLAKE3 digest of their safetensors and an Ed25519 signature over a canonical form
//! of everything else: a line that names this use, then the message in CDR with the signature and
//! the safetensors left empty. The digest is part of it, so the signature covers all fields.

use ed25519_dalek::{Signature, Signer};
pub use ed25519_dalek::{SigningKey, VerifyingKey};

use crate::Error;
use crate::cdr;
use crate::msg::swath::Weights;

/// Most bytes of safetensors that are looked at.
pub const MOST_WEIGHTS_BYTES: usize = 64 * 1024 * 1024;
/// Keeps a signature from being taken for one of something else.
const PURPOSE: &[u8] = b"swath weights v1\n";

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
