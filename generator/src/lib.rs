//! Samples to learn from: scenes, the simulated lidar that sees them, augmentation, labels, and the
//! node that publishes them.
//!
//! Everything is made from a seed and an index, with no clock and no other state: arithmetic is IEEE
//! and `libm`, chance is `ChaCha8`, so a sample has the same bytes on every machine.
//!
//! Source: the paper's section III. Deviations: its scenes are those of one competition's logs, ours
//! are procedural or of any log; the obstacles are what a simulated lidar sees of them, added vehicles
//! included; many scenes have few targets each rather than few scenes many; targets without a path are
//! kept with their outcome.

mod augment;
pub mod config;
mod course;
mod dataset;
mod dice;
pub mod drive;
mod error;
pub mod lidar;
mod logs;
pub mod node;
mod sample;
pub mod scene;
pub mod shape;
mod stream;
mod targets;

pub use config::{GeneratorConfig, Span};
pub use course::Course;
pub use dataset::{Written, write_dataset};
pub use drive::Drive;
pub use error::Error;
pub use logs::LogScenes;
pub use sample::{Generator, SAMPLES_PER_TARGET, Scenes, generate_sample};
pub use scene::{Scene, SceneKind};
pub use stream::{MAX_WORKERS, Run, SampleStream};
