//! The network that predicts the region of a path: ENet as the paper has it, and one that shares the
//! work on a map between its goals.
//!
//! One description of each network (`graph`) is run by two implementations: a fast one for the CPU
//! with its own training pass (`engine`) and a plain one on candle (`reference`).

mod autograd;
mod disc_ways;
mod engine;
mod goal_features;
mod graph;
mod input;
mod onnx;
mod output;
mod parameters;
mod predictor;
mod reach;
mod reference;
mod speed_limits;

pub use autograd::Differentiable;
pub use engine::{Dropout, Isa, Training};
pub use graph::{Architecture, INPUT_PLANES, PARAMETER_COUNT, SIDE_MULTIPLE};
pub use input::{Encoding, InputSize, Surroundings};
pub use onnx::to_onnx;
pub use parameters::{MAX_WEIGHTS_BYTES, Parameters};
pub use predictor::{Network, NetworkInfo, Prediction};
pub use reach::Reach;
pub use reference::Reference;
