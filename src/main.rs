//! The `swath` binary: argument parsing and wiring.

fn main() {}
