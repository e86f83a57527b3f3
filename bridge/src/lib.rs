//! What leaves a swath process: messages and their encoding, zenoh sessions, recordings, log
//! ingestion. It also holds the few types that everything outside is described in: frames and
//! grids, the vehicle's dimensions, outcomes.

mod atomic_file;
mod caught;
pub mod cdr;
pub mod clock;
pub mod drawing;
mod drivability;
mod error;
mod frame;
pub mod geometry;
pub mod goals;
pub mod ingest;
pub mod keys;
mod liveliness;
pub mod map;
pub mod msg;
mod occupancy;
mod outcome;
pub mod picture;
pub mod poses;
mod publisher;
mod queue;
pub mod recording;
pub mod scene;
mod session;
pub mod signature;
mod stop_reason;
mod subscriber;
pub mod transforms;
mod vehicle;
mod weights_store;

pub use caught::caught;
pub use drivability::Drivability;
pub use error::Error;
pub use frame::Frame;
pub use geometry::{Cell, GridSpec, Pose2};
pub use liveliness::{NodeChange, NodeToken, NodeWatcher};
pub use occupancy::{FREE, GridFault, OCCUPIED, OCCUPIED_THRESHOLD, Occupancy, UNKNOWN};
pub use outcome::Outcome;
pub use publisher::{Publisher, RawPublisher};
pub use session::{Ports, Session, SessionConfig, default_namespace, plain_words};
pub use stop_reason::StopReason;
pub use subscriber::{Counts, Received, Subscriber};
pub use vehicle::{CurvatureAtSpeed, CurvatureBySpeed, SpeedLimits, Vehicle};
pub use weights_store::WeightsStore;
