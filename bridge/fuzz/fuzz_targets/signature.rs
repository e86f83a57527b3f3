//! Weights: only what was signed verifies.

#![no_main]

use libfuzzer_sys::fuzz_target;
use swath_bridge::cdr;
use swath_bridge::msg::swath::Weights;
use swath_bridge::signature::{SigningKey, sign, verify};

fuzz_target!(|data: &[u8]| {
    let Ok(mut weights) = cdr::from_slice::<Weights>(data) else {
        return;
    };
    let key = SigningKey::from_bytes(&[7; 32]);
    // Nobody who feeds this knows the key.
    assert!(verify(&weights, &[key.verifying_key()]).is_err());
    let _ = verify(&weights, &[]);
    if sign(&mut weights, &key).is_ok() {
        verify(&weights, &[key.verifying_key()]).expect("what was just signed verifies");
        weights.version ^= 1;
        assert!(verify(&weights, &[]).is_err());
    }
});
