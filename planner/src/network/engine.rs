//! The fast path: forward and backward of [`super::graph`] on the CPU, channels innermost, over one
//! flat vector of parameters. [`super::reference`] computes the same with candle's own operations and
//! is what the tests compare with.

mod inference;
pub(crate) mod kernel;
mod slots;
pub(crate) mod spatial;
mod tables;
#[cfg(test)]
mod tests;
mod training;

pub(crate) use inference::{Inference, Workspace};
pub use kernel::Isa;
pub use training::{Dropout, Training};
