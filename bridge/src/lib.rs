//! What leaves a swath process: messages and their encoding, zenoh sessions, recordings, log
//! ingestion. It also holds the few types that everything outside is described in: frames and
//! grids, the vehicle's dimensions, outcomes.

pub mod cdr;
pub mod clock;
mod error;
mod frame;
pub mod geometry;
pub mod goals;
pub mod keys;
pub mod msg;
mod occupancy;
mod outcome;
pub mod pgm;
pub mod recording;
mod vehicle;

pub use error::Error;
pub use frame::Frame;
pub use geometry::{Cell, GridSpec, Pose2};
pub use occupancy::{FREE, OCCUPIED, OCCUPIED_THRESHOLD, Occupancy, UNKNOWN};
pub use outcome::Outcome;
pub use vehicle::Vehicle;
