//! Signed weights: what is accepted, and that any change to them is not.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use ed25519_dalek::SigningKey;
use proptest::prelude::*;
use swath_bridge::msg::header::Header;
use swath_bridge::msg::swath::Weights;
use swath_bridge::signature::{MOST_WEIGHTS_BYTES, sign, verify};
use swath_bridge::{Error, cdr};

fn key(number: u8) -> SigningKey {
    SigningKey::from_bytes(&[number; 32])
}

fn signed() -> Weights {
    let mut weights = Weights {
        header: Header::at(5, "map"),
        run: "run".to_owned(),
        version: 3,
        step: 20,
        epoch: 1,
        architecture: "enet".to_owned(),
        input_rows: 408,
        input_cols: 152,
        vehicle: "abc".to_owned(),
        loss: 0.25,
        miou: 0.5,
        iou_path: 0.5,
        iou_background: 0.5,
        digest: [0; 32],
        public_key: Vec::new(),
        signature: Vec::new(),
        safetensors: (0..200).collect(),
    };
    sign(&mut weights, &key(1)).unwrap();
    weights
}

#[test]
fn signed_weights_are_accepted_from_those_who_are_trusted() {
    let weights = signed();
    verify(&weights, &[]).unwrap();
    let [one, two] = [1, 2].map(|number| key(number).verifying_key());
    verify(&weights, &[two, one]).unwrap();
    let error = verify(&weights, &[two]).unwrap_err().to_string();
    assert!(error.contains("not trusted"), "{error}");
    assert!(error.contains("\"run\" version 3"), "{error}");
}

#[test]
fn weights_signed_by_another_do_not_pass_under_a_trusted_name() {
    let mut weights = signed();
    sign(&mut weights, &key(2)).unwrap();
    weights.public_key = key(1).verifying_key().to_bytes().to_vec();
    assert!(verify(&weights, &[key(1).verifying_key()]).is_err());
}

#[test]
fn weights_of_any_other_size_of_key_signature_or_tensors_are_refused() {
    let mut long = signed();
    long.public_key.push(0);
    let mut short = signed();
    short.public_key.clear();
    let mut cut = signed();
    cut.signature.pop();
    let mut large = signed();
    large.safetensors = vec![0; MOST_WEIGHTS_BYTES + 1];
    for weights in [long, short, cut, large.clone()] {
        assert!(matches!(
            verify(&weights, &[]),
            Err(Error::BadWeights { .. })
        ));
    }
    assert!(sign(&mut large, &key(1)).is_err());
}

proptest! {
    #[test]
    fn no_byte_of_signed_weights_can_be_changed(at in any::<prop::sample::Index>(), change in 1..=255_u8) {
        let mut payload = cdr::to_vec(&signed()).unwrap();
        // The four bytes in front say how the rest is encoded, and padding is not read.
        let at = 4 + at.index(payload.len() - 4);
        payload[at] ^= change;
        if let Ok(changed) = cdr::from_slice::<Weights>(&payload)
            && changed != signed()
        {
            prop_assert!(verify(&changed, &[]).is_err());
        }
    }
}
