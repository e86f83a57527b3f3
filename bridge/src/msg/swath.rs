//! `swath_msgs`: messages of our own.

use serde::{Deserialize, Serialize};

use super::Message;
use super::header::Header;

/// How well regions match labels, as counts of cells, so that results can be added up.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Header.
    pub header: Header,
    /// Run.
    pub run: String,
    /// Weights version.
    pub weights_version: u64,
    /// Architecture, or the name of a baseline without learning.
    pub predictor: String,
    /// What was evaluated on.
    pub split: String,
    /// Empty for all of it, else "scene/clutter" or "distance/10-20 m".
    pub group: String,
    /// Dilation m.
    pub dilation_m: f32,
    /// Samples.
    pub samples: u64,
    /// Intersection path.
    pub intersection_path: u64,
    /// Union path.
    pub union_path: u64,
    /// Intersection background.
    pub intersection_background: u64,
    /// Union background.
    pub union_background: u64,
    /// Regions that join vehicle and target.
    pub joined: u64,
    /// Ms per sample.
    pub ms_per_sample: f32,
}

impl Message for Evaluation {
    const TYPE_NAME: &'static str = "swath_msgs/msg/Evaluation";
}

/// One frame's plans, or why there are none. The header is that of the grid which was planned on, and
/// every pose is in its frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlanReport {
    /// Header.
    pub header: Header,
    /// Vehicle.
    pub vehicle: String,
    /// Counts up by one for each plan of this planner; 0 if no frame was planned.
    pub frame: u64,
    /// Method; empty if no frame was planned.
    pub method: String,
    /// Kind of scene where it is known, else empty.
    pub scene: String,
    /// Speed m per s.
    pub speed_m_per_s: f32,
    /// Empty when no network was used.
    pub weights_run: String,
    /// 0 when no network was used.
    pub weights_version: u64,
    /// Since their header's stamp; NaN when no network was used.
    pub weights_age_s: f32,
    /// What a network was asked for: without, all, not-needed, no-time or hard.
    pub consulted: String,
    /// Elapsed.
    pub network_ms: f32,
    /// Elapsed.
    pub search_ms: f32,
    /// Processor time of the whole plan.
    pub cpu_ms: f32,
    /// Elapsed, network and search.
    pub total_ms: f32,
    /// Elapsed after that, making paths drivable.
    pub smooth_ms: f32,
    /// For all of these; 0 for none.
    pub deadline_ms: f32,
    /// From the grid's arrival to this report; NaN if no frame was planned.
    pub latency_ms: f32,
    /// Grids that a newer one replaced before they were planned on.
    pub grids_skipped: u64,
    /// Where paths begin: where the vehicle will be when it can follow them.
    pub start: PlanarPose,
    /// Number of the target whose path is to be followed; -1 for none: stop.
    pub chosen: i32,
    /// Targets.
    pub targets: Vec<TargetPlan>,
    /// Why the path is empty, as [`crate::StopReason`] names it; empty if there is one.
    pub reason: String,
    /// The evidence, for people.
    pub detail: String,
    /// Messages that could not be used since the planner began.
    pub rejected: Vec<Rejection>,
}

impl Message for PlanReport {
    const TYPE_NAME: &'static str = "swath_msgs/msg/PlanReport";
}

/// A pose in the plane. Vehicle frame unless the message that holds it says otherwise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlanarPose {
    /// Forward in the vehicle frame.
    pub x_m: f32,
    /// Left in the vehicle frame.
    pub y_m: f32,
    /// Counter-clockwise.
    pub yaw_rad: f32,
}

impl Message for PlanarPose {
    const TYPE_NAME: &'static str = "swath_msgs/msg/PlanarPose";
}

/// Messages of one topic that a planner could not use, for one cause.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rejection {
    /// Last part of the key: grid, odom, tf, reference, targets, or weights.
    pub topic: String,
    /// The same words for all messages with this cause.
    pub cause: String,
    /// Since the planner began.
    pub messages: u64,
}

impl Message for Rejection {
    const TYPE_NAME: &'static str = "swath_msgs/msg/Rejection";
}

/// One labelled training sample, reproducible from seed and index.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Stamped from the index, not the clock.
    pub header: Header,
    /// Generator.
    pub generator: String,
    /// Counts up by one for each generator.
    pub sequence: u64,
    /// Seed.
    pub seed: u64,
    /// Index.
    pub index: u64,
    /// Kind of scene, or the name of the log it came from.
    pub scene: String,
    /// Samples with the same id share a scene.
    pub scene_id: u64,
    /// Speed m per s.
    pub speed_m_per_s: f32,
    /// Goal.
    pub goal: PlanarPose,
    /// Code of an [`crate::Outcome`].
    pub outcome: u8,
    /// Rows.
    pub rows: u32,
    /// Cols.
    pub cols: u32,
    /// Resolution m.
    pub resolution_m: f32,
    /// Ego row.
    pub ego_row: u32,
    /// Ego col.
    pub ego_col: u32,
    /// As a lidar on the vehicle has seen them.
    #[serde(with = "serde_bytes")]
    pub obstacles: Vec<u8>,
    /// Shifted reference path, dilated.
    #[serde(with = "serde_bytes")]
    pub reference: Vec<u8>,
    /// Disc around the goal.
    #[serde(with = "serde_bytes")]
    pub target: Vec<u8>,
    /// Dilated optimal path; empty of set cells unless solved.
    #[serde(with = "serde_bytes")]
    pub label: Vec<u8>,
    /// The optimal path, not dilated.
    pub path: Vec<PlanarPose>,
    /// Metres + radians.
    pub cost: f32,
    /// Expansions of the search that made the label.
    pub steps: u64,
}

impl Message for Sample {
    const TYPE_NAME: &'static str = "swath_msgs/msg/Sample";
}

/// What became of one target.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TargetPlan {
    /// Goal.
    pub goal: PlanarPose,
    /// Status.
    pub status: u8,
    /// Metres + radians, never scaled; NaN unless solved.
    pub cost: f64,
    /// The cost is at most so many times the optimum; NaN if nothing is proved.
    pub bound: f32,
    /// NaN unless solved.
    pub length_m: f64,
    /// Expansions.
    pub steps: u64,
    /// Processor time of this target's search.
    pub time_ms: f32,
    /// Drivability.
    pub drivability: u8,
    /// At most 0.2 m apart; empty unless solved.
    pub path: Vec<PlanarPose>,
    /// One a pose, to the left; empty for chords.
    pub curvature_per_m: Vec<f32>,
}

impl Message for TargetPlan {
    const TYPE_NAME: &'static str = "swath_msgs/msg/TargetPlan";
}

/// How training goes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainStatus {
    /// Header.
    pub header: Header,
    /// Run.
    pub run: String,
    /// Step.
    pub step: u64,
    /// Epoch.
    pub epoch: u64,
    /// Epochs.
    pub epochs: u64,
    /// Consumed so far.
    pub samples: u64,
    /// Samples per s.
    pub samples_per_s: f32,
    /// From the stream.
    pub received: u64,
    /// Sequence numbers that never came.
    pub gaps: u64,
    /// Duplicates.
    pub duplicates: u64,
    /// Messages that did not decode or did not fit.
    pub rejected: u64,
    /// Buffered.
    pub buffered: u32,
    /// Learning rate.
    pub learning_rate: f32,
    /// Loss.
    pub loss: f32,
    /// NaN when nothing was evaluated yet.
    pub miou: f32,
    /// Weights version.
    pub weights_version: u64,
    /// NaN when there is no end.
    pub eta_s: f32,
}

impl Message for TrainStatus {
    const TYPE_NAME: &'static str = "swath_msgs/msg/TrainStatus";
}

/// A network's parameters, complete and signed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Weights {
    /// Header.
    pub header: Header,
    /// Run.
    pub run: String,
    /// Counts up by one with each publication of the run.
    pub version: u64,
    /// Step.
    pub step: u64,
    /// Epoch.
    pub epoch: u64,
    /// Architecture.
    pub architecture: String,
    /// Of the network's input, padding included.
    pub input_rows: u32,
    /// Input cols.
    pub input_cols: u32,
    /// Digest of the vehicle's dimensions.
    pub vehicle: String,
    /// Loss.
    pub loss: f32,
    /// On the validation set, NaN when there is none.
    pub miou: f32,
    /// Iou path.
    pub iou_path: f32,
    /// Iou background.
    pub iou_background: f32,
    /// BLAKE3 of safetensors.
    pub digest: [u8; 32],
    /// Ed25519, 32 bytes.
    #[serde(with = "serde_bytes")]
    pub public_key: Vec<u8>,
    /// Ed25519 over the signed fields, 64 bytes.
    #[serde(with = "serde_bytes")]
    pub signature: Vec<u8>,
    /// Safetensors.
    #[serde(with = "serde_bytes")]
    pub safetensors: Vec<u8>,
}

impl Message for Weights {
    const TYPE_NAME: &'static str = "swath_msgs/msg/Weights";
}
