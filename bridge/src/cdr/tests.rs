use super::*;
use crate::msg::header::{Header, Time};
use crate::msg::nav::OccupancyGrid;
use proptest::prelude::*;
use serde::Deserialize;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Mixed {
    flag: bool,
    small: i8,
    wide: f64,
    text: String,
    #[serde(with = "serde_bytes")]
    bytes: Vec<u8>,
    numbers: Vec<u16>,
    header: Header,
    last: u64,
}

fn mixed() -> impl Strategy<Value = Mixed> {
    (
        any::<bool>(),
        any::<i8>(),
        -1e9..1e9f64,
        "[a-zé]{0,9}",
        proptest::collection::vec(any::<u8>(), 0..20),
        proptest::collection::vec(any::<u16>(), 0..9),
        (any::<i32>(), any::<u32>(), any::<u64>()),
    )
        .prop_map(
            |(flag, small, wide, text, bytes, numbers, (sec, nanosec, last))| Mixed {
                flag,
                small,
                wide,
                text,
                bytes,
                numbers,
                header: Header {
                    stamp: Time { sec, nanosec },
                    frame_id: "odom".to_owned(),
                },
                last,
            },
        )
}

proptest! {
    #[test]
    fn what_was_written_is_read_back(value in mixed()) {
        let payload = to_vec(&value).unwrap();
        prop_assert_eq!(from_slice::<Mixed>(&payload).unwrap(), value);
    }

    #[test]
    fn every_truncation_is_an_error(value in mixed(), cut in 1usize..40) {
        let payload = to_vec(&value).unwrap();
        let len = payload.len().saturating_sub(cut);
        prop_assert!(from_slice::<Mixed>(&payload[..len]).is_err());
    }

    #[test]
    fn no_bytes_panic(payload in proptest::collection::vec(any::<u8>(), 0..200)) {
        let _ = from_slice::<Mixed>(&payload);
        let _ = from_slice::<OccupancyGrid>(&payload);
    }
}

#[test]
fn alignment_counts_from_behind_the_encapsulation() {
    #[derive(Serialize)]
    struct ByteThenDouble {
        byte: u8,
        double: f64,
    }
    let payload = to_vec(&ByteThenDouble {
        byte: 7,
        double: 1.0,
    })
    .unwrap();
    let mut expected = vec![0, 1, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0];
    expected.extend_from_slice(&1.0f64.to_le_bytes());
    assert_eq!(payload, expected);
}

#[test]
fn big_endian_is_read() {
    let payload = [0, 0, 0, 0, 0, 0, 1, 2, 0, 0, 0, 5];
    let time: Time = from_slice(&payload).unwrap();
    assert_eq!(
        time,
        Time {
            sec: 258,
            nanosec: 5
        }
    );
}

#[test]
fn a_hostile_length_is_refused_before_anything_is_allocated() {
    let mut payload = vec![0, 1, 0, 0];
    payload.extend_from_slice(&u32::MAX.to_le_bytes());
    let error = from_slice::<Vec<u8>>(&payload).unwrap_err();
    assert_eq!(
        error,
        CdrError::LengthBeyondPayload {
            what: "sequence",
            offset: 4,
            claimed: u32::MAX,
            left: 0
        }
    );
}

#[test]
fn bytes_behind_the_message_are_an_error_unless_they_pad() {
    let mut payload = to_vec(&5u32).unwrap();
    for _ in 0..=15 {
        assert_eq!(from_slice::<u32>(&payload), Ok(5));
        payload.push(0);
    }
    assert_eq!(
        from_slice::<u32>(&payload),
        Err(CdrError::TrailingBytes {
            offset: 8,
            left: 16
        })
    );
    payload[8] = 1;
    assert!(from_slice::<u32>(&payload[..9]).is_err());
    assert!(from_slice::<u32>(&payload[..12]).is_err());
}

#[test]
fn the_beginning_of_a_message_is_read_without_its_rest() {
    let mut payload = to_vec(&5u32).unwrap();
    payload.extend([7; 40]);
    assert_eq!(beginning_of::<u32>(&payload), Ok(5));
    assert!(beginning_of::<u32>(&payload[..7]).is_err());
}

#[test]
fn other_encapsulations_are_named() {
    for (kind, said) in [
        (7, "XCDR2, little endian"),
        (3, "parameter list CDR"),
        (11, "parameter list XCDR2"),
        (99, "00 63, expected"),
    ] {
        let mut payload = to_vec(&5u32).unwrap();
        payload[1] = kind;
        let error = from_slice::<u32>(&payload).unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
    }
}

#[test]
fn agrees_with_another_implementation() {
    let header = Header {
        stamp: Time { sec: 3, nanosec: 9 },
        frame_id: "base_link".to_owned(),
    };
    let payload = to_vec(&header).unwrap();
    let (read, consumed) =
        cdr_encoding::from_bytes::<Header, byteorder::LittleEndian>(&payload[4..]).unwrap();
    assert_eq!((read, consumed), (header, payload.len() - 4));
}
