use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use tempfile::TempDir;

use super::*;
use crate::recording::RawMessage;

const MESSAGES: u32 = 81;

/// A file with two chunks of 41 and 40 messages, and where the second chunk begins.
fn two_chunks(compression: Option<Compression>) -> (Vec<u8>, usize) {
    let mut bytes = Cursor::new(Vec::new());
    let options = WriteOptions::new()
        .compression(compression)
        .chunk_size(None);
    let mut writer = options.create(&mut bytes).unwrap();
    let schema = writer.add_schema("a_msgs/msg/A", "ros2msg", b"x").unwrap();
    let channel = writer
        .add_channel(schema, "/a", "cdr", &BTreeMap::new())
        .unwrap();
    for sequence in 0..MESSAGES {
        let header = MessageHeader {
            channel_id: channel,
            sequence,
            log_time: u64::from(sequence) * 7,
            publish_time: 3,
        };
        writer
            .write_to_known_channel(&header, &payload(sequence))
            .unwrap();
        if sequence == 40 {
            writer.flush().unwrap();
        }
    }
    writer.finish().unwrap();
    drop(writer);
    let bytes = bytes.into_inner();
    let chunks: Vec<usize> = records(&bytes)
        .into_iter()
        .filter(|(_, kind)| *kind == op::CHUNK)
        .map(|(offset, _)| offset)
        .collect();
    let [_, second] = chunks[..] else {
        panic!("{chunks:?}");
    };
    (bytes, second)
}

fn payload(sequence: u32) -> Vec<u8> {
    let mut payload = vec![0, 1, 0, 0];
    for number in 0..200u32 {
        payload.extend((sequence.wrapping_mul(2_654_435_761) ^ (number * 40_503)).to_le_bytes());
    }
    payload
}

/// Offset and kind of every record.
fn records(bytes: &[u8]) -> Vec<(usize, u8)> {
    let (mut offset, mut found) = (8, Vec::new());
    while offset + 9 <= bytes.len() {
        let len = u64::from_le_bytes(bytes[offset + 1..offset + 9].try_into().unwrap());
        found.push((offset, bytes[offset]));
        offset += 9 + usize::try_from(len).unwrap();
    }
    found
}

/// What the head of a chunk says, changed.
struct Head {
    record_len: u64,
    unpacked_len: u64,
    checksum: u32,
    packed_len: u64,
}

fn put_head(bytes: &mut [u8], chunk: usize, head: &Head) {
    let name_len = u32::from_le_bytes(bytes[chunk + 37..chunk + 41].try_into().unwrap());
    let packed = chunk + 41 + usize::try_from(name_len).unwrap();
    bytes[chunk + 1..chunk + 9].copy_from_slice(&head.record_len.to_le_bytes());
    bytes[chunk + 25..chunk + 33].copy_from_slice(&head.unpacked_len.to_le_bytes());
    bytes[chunk + 33..chunk + 37].copy_from_slice(&head.checksum.to_le_bytes());
    bytes[packed..packed + 8].copy_from_slice(&head.packed_len.to_le_bytes());
}

/// Recovers a file and checks that what is saved are the first messages, whole and readable.
fn saved(bytes: &[u8]) -> (Vec<RawMessage>, RecoverReport) {
    let folder = TempDir::new().unwrap();
    let [input, output] = ["a", "b"].map(|name| folder.path().join(name));
    std::fs::write(&input, bytes).unwrap();
    let report = recover(&input, &output, Existing::Refuse, &mut |_, _| ()).unwrap();
    let messages: Vec<RawMessage> = Reader::open(&output).unwrap().map(Result::unwrap).collect();
    for (sequence, message) in (0..).zip(&messages) {
        assert_eq!(message.sequence, sequence);
        assert_eq!(message.payload, payload(sequence));
    }
    assert_eq!(u64::try_from(messages.len()).unwrap(), report.messages);
    (messages, report)
}

fn packings() -> [Option<Compression>; 3] {
    [None, Some(Compression::Zstd), Some(Compression::Lz4)]
}

/// Bytes of the second chunk's body.
fn body_len(bytes: &[u8], chunk: usize) -> u64 {
    u64::from_le_bytes(bytes[chunk + 1..chunk + 9].try_into().unwrap())
}

#[test]
fn a_last_chunk_whose_head_was_never_filled_in_is_saved() {
    for compression in packings() {
        let (bytes, chunk) = two_chunks(compression);
        let end = chunk + 9 + usize::try_from(body_len(&bytes, chunk)).unwrap();
        for unknown in [0, u64::MAX] {
            for checksum in [0, u32::MAX] {
                let mut died = bytes[..end].to_vec();
                let head = Head {
                    record_len: unknown,
                    unpacked_len: unknown,
                    checksum,
                    packed_len: unknown,
                };
                put_head(&mut died, chunk, &head);
                let (messages, report) = saved(&died);
                assert_eq!(messages.len(), 81, "{compression:?} {unknown}: {report:?}");
                assert!(report.has_no_end && report.bytes_lost == 0, "{report:?}");
                let said = &report.damage[0];
                assert!(said.contains("40 message(s) of it are saved"), "{said}");
                // Reading it says what to do, and gives what is whole.
                let read = Reader::new(Cursor::new(died), "died.mcap").unwrap();
                let read: Vec<_> = read.collect();
                assert_eq!(read.len(), 42);
                let error = read[41].as_ref().unwrap_err().to_string();
                assert!(error.contains("swath bridge recover"), "{error}");
            }
        }
    }
}

#[test]
fn of_a_chunk_that_ends_in_the_middle_whole_messages_are_saved() {
    for compression in packings() {
        let (bytes, chunk) = two_chunks(compression);
        let len = usize::try_from(body_len(&bytes, chunk)).unwrap();
        for part in 1..12 {
            let mut died = bytes[..chunk + 9 + 45 + (len - 45) * part / 12].to_vec();
            let head = Head {
                record_len: u64::MAX,
                unpacked_len: u64::MAX,
                checksum: u32::MAX,
                packed_len: u64::MAX,
            };
            put_head(&mut died, chunk, &head);
            let (messages, report) = saved(&died);
            assert!((41..81).contains(&messages.len()) && report.has_no_end);
            if compression.is_none() {
                assert_eq!(messages.len(), 41 + 40 * part / 12, "{part}");
            }
        }
    }
}

#[test]
fn lengths_that_are_known_are_used_where_others_are_not() {
    for compression in packings() {
        let (bytes, chunk) = two_chunks(compression);
        let name_len = u32::from_le_bytes(bytes[chunk + 37..chunk + 41].try_into().unwrap());
        let record_len = body_len(&bytes, chunk);
        let packed_len = record_len - 40 - u64::from(name_len);
        for head in [
            // Only the checksum, or only what is unpacked, is not filled in.
            Head {
                record_len,
                unpacked_len: 81,
                checksum: u32::MAX,
                packed_len,
            },
            Head {
                record_len,
                unpacked_len: u64::MAX,
                checksum: 7,
                packed_len,
            },
            Head {
                record_len,
                unpacked_len: 0,
                checksum: 0,
                packed_len: 0,
            },
            Head {
                record_len,
                unpacked_len: u64::MAX,
                checksum: 0,
                packed_len: u64::MAX,
            },
            // The record's own length is not, but the chunk's is: what comes behind it is found.
            Head {
                record_len: 0,
                unpacked_len: 0,
                checksum: 0,
                packed_len,
            },
        ] {
            let mut odd = bytes.clone();
            put_head(&mut odd, chunk, &head);
            let (messages, report) = saved(&odd);
            assert_eq!(messages.len(), 81, "{compression:?} {report:?}");
            assert!(!report.has_no_end && report.damage.len() == 1, "{report:?}");
        }
    }
}

/// A file with one chunk of zeros that is far larger unpacked than in the file.
fn giant(messages: u32, message_len: usize) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let options = WriteOptions::new()
        .compression(Some(Compression::Zstd))
        .chunk_size(None);
    let mut writer = options.create(&mut bytes).unwrap();
    let schema = writer.add_schema("a_msgs/msg/A", "ros2msg", b"x").unwrap();
    let channels = ["/a", "/b"].map(|topic| {
        let none = BTreeMap::new();
        writer.add_channel(schema, topic, "cdr", &none).unwrap()
    });
    let payload = vec![0; message_len];
    for sequence in 0..messages {
        let header = MessageHeader {
            channel_id: channels[usize::from(sequence % 2 == 1)],
            sequence,
            log_time: u64::from(sequence / 2),
            publish_time: 3,
        };
        writer.write_to_known_channel(&header, &payload).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

#[test]
fn a_chunk_that_is_larger_than_memory_should_be_is_read_piece_by_piece() {
    // 300 MB unpacked, in messages of 1 MB.
    let bytes = giant(300, 1_000_000);
    assert!(bytes.len() < 200_000, "{}", bytes.len());
    let read = Reader::new(Cursor::new(&bytes), "giant.mcap").unwrap();
    assert_eq!(read.map(Result::unwrap).count(), 300);
    // Its checksum is looked at before anything is given.
    let chunk = records(&bytes)
        .into_iter()
        .find(|(_, kind)| *kind == op::CHUNK)
        .unwrap()
        .0;
    let mut damaged = bytes.clone();
    damaged[chunk + 33] ^= 1;
    let read: Vec<_> = Reader::new(Cursor::new(&damaged), "giant.mcap")
        .unwrap()
        .collect();
    assert_eq!(read.len(), 1);
    let error = read[0].as_ref().unwrap_err().to_string();
    assert!(error.contains("damaged chunk"), "{error}");
}

#[test]
fn a_chunk_that_claims_more_than_the_limit_is_refused_and_still_recovered() {
    let (bytes, chunk) = two_chunks(Some(Compression::Zstd));
    let mut odd = bytes.clone();
    odd[chunk + 25..chunk + 33].copy_from_slice(&(1u64 << 45).to_le_bytes());
    let read: Vec<_> = Reader::new(Cursor::new(&odd), "giant.mcap")
        .unwrap()
        .collect();
    let error = read[41].as_ref().unwrap_err().to_string();
    assert!(error.contains(&MOST_CHUNK_BYTES.to_string()), "{error}");
    assert!(error.contains("swath bridge recover"), "{error}");
    assert_eq!(saved(&odd).0.len(), 81);
}

#[test]
fn damage_is_listed_up_to_a_limit() {
    let (bytes, chunk) = two_chunks(None);
    let mut odd = bytes[..chunk].to_vec();
    // Messages on a channel that nobody named.
    for _ in 0..3000 {
        odd.push(op::MESSAGE);
        odd.extend(22u64.to_le_bytes());
        odd.extend(900u16.to_le_bytes());
        odd.extend([0; 20]);
    }
    let (messages, report) = saved(&odd);
    assert_eq!((messages.len(), report.messages_lost), (41, 3000));
    assert_eq!(report.damage.len(), MOST_DAMAGE + 1);
}
