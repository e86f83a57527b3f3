//! What runs on the vehicle: collision maps, the lookup table, search, the network's forward pass
//! and the planner node.

mod action;
pub mod check;
mod choice;
mod collision;
pub mod dubins;
mod error;
mod frame;
mod ground;
mod guidance;
mod hybrid;
mod kernel;
mod method;
mod motion;
pub mod network;
pub mod node;
mod path_point;
mod plan;
mod plane;
mod polyline;
mod pool;
pub mod report;
mod rrt_star;
pub mod search;
mod segment;
pub mod smooth;
mod targets;
mod timing;
mod tolerance;

pub use action::{ACTIONS, AHEAD, Action, ActionTable, DIRECTIONS, REACH_CELLS};
pub use choice::{ChoiceConfig, choose};
pub use collision::CollisionMap;
pub use error::Error;
pub use frame::{
    Consulted, FrameInput, FramePlan, FramePlanner, ObstacleConfig, Start, grid_around,
};
pub use guidance::Guidance;
pub use method::Method;
pub use motion::{MotionModel, Successors};
pub use path_point::PathPoint;
pub use plan::{PlanConfig, Planner, TargetOrder, TargetPlan};
pub use plane::Plane;
pub use report::plan_report;
pub use segment::after_arc;
pub use targets::{MAX_DISTANCE_M, MAX_TARGETS, TargetConfig, sample_targets};
pub use timing::{CpuTimer, millis};
pub use tolerance::{GOAL_TOLERANCE_M, GOAL_TOLERANCE_RAD, GoalTolerance, Target};
