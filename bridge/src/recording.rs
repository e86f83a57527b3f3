//! Recordings: MCAP files of profile `ros2` with CDR messages, as rosbag2 and Foxglove use them.
//!
//! [`Writer`] and [`Reader`] are all that the rest of swath needs; both work on files of any size
//! with bounded memory. Reading trusts no length in the file: what a record claims is checked
//! against the bytes that are left and against named limits before anything is allocated.
//!
//! A [`Log`] is what users have: a file, a compressed file, or a rosbag2 folder of several.

mod channel;
mod chunk;
mod claim;
mod definitions;
mod distinct;
mod info;
mod log;
mod message;
mod metadata;
pub(crate) mod order;
mod pattern;
mod reader;
mod record;
mod recorder;
mod recover;
mod replay;
mod source;
mod times;
mod writer;

pub use channel::Channel;
pub use claim::{Existing, check_out};
pub(crate) use definitions::DefinitionsByFile;
pub use distinct::{Distinct, distinct};
pub use info::{Info, TopicInfo, info};
pub use log::{Log, LogReader};
pub use message::RawMessage;
pub use reader::Reader;
pub use recorder::{RecordCounts, RecordOptions, Recorder};
pub use recover::{RecoverReport, recover};
pub use replay::{ReplayOptions, ReplayReport, replay};
pub use source::Source;
pub use writer::{Stamps, Writer};

#[cfg(test)]
mod tests;
