//! What can go wrong in planning, apart from there being no path, which is an outcome.

use swath_bridge::GridSpec;

/// Errors of this crate, each with the evidence.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Packed bits of the wrong length.
    #[error("a plane of {rows} x {cols} cells takes {wanted} bytes, got {bytes}")]
    Plane {
        /// Rows that were claimed.
        rows: u32,
        /// Columns that were claimed.
        cols: u32,
        /// Bytes that came.
        bytes: usize,
        /// Bytes that the cells take.
        wanted: usize,
    },
    /// Bits behind the last cell are set.
    #[error("a plane of {rows} x {cols} cells has bits set behind its last cell")]
    PlanePadding {
        /// Rows that were claimed.
        rows: u32,
        /// Columns that were claimed.
        cols: u32,
    },
    /// A bound on costs that no search can keep.
    #[error("epsilon is {epsilon}, expected 1 to 64")]
    Epsilon {
        /// The bound that was asked for.
        epsilon: f64,
    },
    /// An order of targets names one that is not there.
    #[error("the order of targets names number {number} of {goals}")]
    Order {
        /// Number in the order, counted from 0.
        number: usize,
        /// Targets that there are.
        goals: usize,
    },
    /// A setting of planning is out of its range.
    #[error("plan.{field} is {value}, expected {least} to {most}")]
    PlanConfig {
        /// Which.
        field: &'static str,
        /// What it is.
        value: f64,
        /// Least that it may be.
        least: f64,
        /// Most that it may be.
        most: f64,
    },
    /// A part of the node panicked.
    #[error("the node panicked: {what}")]
    Panicked {
        /// What the panic said.
        what: String,
    },
    /// A setting of following paths is out of its range.
    #[error("follow.{field} is {value}, expected 0 to {most}")]
    FollowConfig {
        /// Which.
        field: &'static str,
        /// What it is.
        value: f64,
        /// Most that it may be.
        most: f64,
    },
    /// A setting of frames is out of its range.
    #[error("frames.{field} is {value}, expected 0 to {max}")]
    FramesConfig {
        /// Which.
        field: &'static str,
        /// What it is.
        value: f64,
        /// Maximum that it may be.
        max: f64,
    },
    /// Cells are too small for the vehicle, or not positive.
    #[error(
        "a vehicle that reaches {vehicle_m:.2} m on cells of {resolution_m} m: expected at most 400 cells"
    )]
    Resolution {
        /// Side of a cell.
        resolution_m: f64,
        /// How far the vehicle reaches from its origin.
        vehicle_m: f64,
    },
    /// A plane's size is not the grid's.
    #[error("{what}: {} x {} cells, expected {} x {}", got.0, got.1, wanted.0, wanted.1)]
    Shape {
        /// Which plane.
        what: &'static str,
        /// Rows and columns that it has.
        got: (u32, u32),
        /// Rows and columns that it should have.
        wanted: (u32, u32),
    },
    /// The swept cells were computed for another resolution.
    #[error("the grid has cells of {grid_m} m, but the motion model is for {model_m} m")]
    ResolutionMismatch {
        /// Side of the grid's cells.
        grid_m: f64,
        /// Side of the model's cells.
        model_m: f64,
    },
    /// The network was trained on another grid.
    #[error(
        "the grid is {}, but the network is for {}",
        grid_text(got),
        grid_text(wanted)
    )]
    GridMismatch {
        /// The grid.
        got: GridSpec,
        /// The network's.
        wanted: GridSpec,
    },
    /// A region's weight is out of range.
    #[error("a region's weight is {weight}, expected more than 0 and at most 1")]
    RegionWeight {
        /// The weight.
        weight: f64,
    },
    /// There must be a region for each goal.
    #[error("{regions} region(s) for {goals} goal(s), expected one each")]
    RegionCount {
        /// Regions given.
        regions: usize,
        /// Goals given.
        goals: usize,
    },
    /// A weights file is not one that this network can use.
    #[error("weights: {what}")]
    Weights {
        /// What was found and what was expected.
        what: String,
    },
    /// A setting of the smoother is out of range.
    #[error("smoother: {field} is {value}, expected more than 0 and at most {most}")]
    SmoothConfig {
        /// The setting.
        field: &'static str,
        /// Its value.
        value: f64,
        /// The largest that is allowed.
        most: f64,
    },
    /// Error of the bridge.
    #[error(transparent)]
    Bridge(#[from] swath_bridge::Error),
}

fn grid_text(spec: &GridSpec) -> String {
    format!(
        "{} x {} cells of {} m with the vehicle at ({}, {})",
        spec.rows, spec.cols, spec.resolution_m, spec.ego_row, spec.ego_col
    )
}
