//! Recordings: MCAP files of profile `ros2` with CDR messages, as rosbag2 and Foxglove use them.
//!
//! [`Writer`] and [`Reader`] are all that the rest of swath needs; both work on files of any size
//! with bounded memory. Reading trusts no length in the file: what a record claims is checked
//! against the bytes that are left and against named limits before anything is allocated.

mod channel;
mod chunk;
mod definitions;
mod info;
mod message;
mod reader;
mod record;
mod recorder;
mod recover;
mod replay;
mod writer;

pub use channel::Channel;
pub use info::{Info, TopicInfo, info};
pub use message::RawMessage;
pub use reader::Reader;
pub use recorder::{RecordCounts, RecordOptions, Recorder};
pub use recover::{RecoverReport, recover};
pub use replay::{ReplayOptions, ReplayReport, replay};
pub use writer::{Stamps, Writer};

#[cfg(test)]
mod tests;
