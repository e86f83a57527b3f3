//! The network that predicts the region of a path: ENet as the paper has it.
//!
//! One description of the network (`graph`) is run by two implementations: a fast one for the CPU
//! with its own training pass (`engine`) and a plain one on candle (`reference`).

mod engine;
mod graph;
mod input;
mod parameters;
mod predictor;
mod reference;

pub use engine::{Dropout, Isa, Training};
pub use graph::{INPUT_PLANES, PARAMETER_COUNT, SIDE_MULTIPLE};
pub use input::{Encoding, InputSize};
pub use parameters::{MAX_WEIGHTS_BYTES, Parameters};
pub use predictor::{ARCHITECTURE, Network, NetworkInfo};
pub use reference::Reference;
