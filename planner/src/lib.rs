//! What runs on the vehicle: collision maps, the lookup table, search, the network's forward pass
//! and the planner node.

mod error;
mod plane;

pub use error::Error;
pub use plane::Plane;
