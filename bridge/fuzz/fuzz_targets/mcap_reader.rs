//! Recordings: reading comes to an end, and what decodes does so within bounds.
//!
//! With an odd first byte the input is what follows a good beginning, so that records are reached.

#![no_main]

use std::io::Cursor;

use libfuzzer_sys::fuzz_target;
use swath_bridge::msg::nav::Path;
use swath_bridge::msg::swath::Sample;
use swath_bridge::recording::Reader;

/// The magic bytes and an empty header record.
const BEGINNING: &[u8] = b"\x89MCAP0\r\n\x01\x08\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0";

fuzz_target!(|data: &[u8]| {
    let Some((&kind, rest)) = data.split_first() else {
        return;
    };
    let file = if kind % 2 == 1 {
        [BEGINNING, rest].concat()
    } else {
        rest.to_vec()
    };
    let Ok(reader) = Reader::new(Cursor::new(file), "fuzz.mcap") else {
        return;
    };
    let mut has_failed = false;
    for message in reader {
        assert!(!has_failed, "nothing follows an error");
        match message {
            Ok(message) => {
                let _ = message.decode::<Path>();
                let _ = message.decode::<Sample>();
            }
            Err(_) => has_failed = true,
        }
    }
});
