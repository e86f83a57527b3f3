//! Networks in safetensors files: loading comes to an end, with a network or an error.
//!
//! With an odd first byte the input is a list of changes to a good file, four bytes each: place
//! (three bytes) and value; else it is the file.

#![no_main]

use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use swath_planner::network::{Architecture, Network, NetworkInfo, Parameters};

/// Bytes at the beginning of a good file that are changed: its header, and some of what follows.
const CHANGED_BYTES: usize = 32 * 1024;

fn good_file() -> &'static [u8] {
    static FILE: OnceLock<Vec<u8>> = OnceLock::new();
    FILE.get_or_init(|| Network::save(&NetworkInfo::default(), &Parameters::initial(Architecture::default(), 1)))
}

fuzz_target!(|data: &[u8]| {
    let Some((&kind, rest)) = data.split_first() else {
        return;
    };
    let file = if kind % 2 == 1 {
        let mut file = good_file().to_vec();
        let most = CHANGED_BYTES.min(file.len());
        let (changes, _) = rest.as_chunks::<4>();
        for &[a, b, c, value] in changes {
            let place = usize::from(a) | usize::from(b) << 8 | usize::from(c) << 16;
            file[place % most] = value;
        }
        file
    } else {
        rest.to_vec()
    };
    if let Ok(network) = Network::load(&file) {
        let _ = network.info();
    }
});
