//! Plan reports: one row a report, one a target of it.

use swath_bridge::msg::swath::{PlanReport, TargetPlan};
use swath_bridge::{Drivability, Outcome};

use super::Record;
use super::rows::{number, row_table};

/// Offset basis and prime of FNV-1a over 64 bits.
const FNV: (u64, u64) = (0xcbf2_9ce4_8422_2325, 0x0000_0100_0000_01b3);

row_table! {
    /// One report of a planned frame.
    pub(crate) struct PlanRow in "plans" {
        plan: u64,
        recording: u32,
        log_nanos: u64,
        stamp_nanos: u64,
        vehicle: String,
        frame: u64,
        method: String,
        scene: String,
        speed_m_per_s: Option<f64>,
        targets: u32,
        /// Plans to the same goals have the same one.
        goals_digest: u64,
        solved: u32,
        steps: u64,
        weights_run: String,
        weights_version: u64,
        weights_age_s: Option<f64>,
        network_ms: Option<f64>,
        search_ms: Option<f64>,
        cpu_ms: Option<f64>,
        total_ms: Option<f64>,
        smooth_ms: Option<f64>,
        deadline_ms: Option<f64>,
        latency_ms: Option<f64>,
        grids_skipped: u64,
        /// Number of the target whose path was to be followed; negative for none.
        chosen: i64,
    }
}

impl PlanRow {
    pub(super) fn new(plan: u64, record: &Record<'_>, report: PlanReport) -> Self {
        let solved = report
            .targets
            .iter()
            .filter(|target| target.status == Outcome::Solved.code())
            .count();
        let steps = report
            .targets
            .iter()
            .fold(0u64, |sum, target| sum.saturating_add(target.steps));
        Self {
            plan,
            recording: record.recording,
            log_nanos: record.message.log_nanos,
            stamp_nanos: report.header.stamp.nanos(),
            frame: report.frame,
            speed_m_per_s: number(report.speed_m_per_s),
            targets: count(report.targets.len()),
            goals_digest: goals_digest(&report.targets),
            solved: count(solved),
            steps,
            weights_version: report.weights_version,
            weights_age_s: number(report.weights_age_s),
            network_ms: number(report.network_ms),
            search_ms: number(report.search_ms),
            cpu_ms: number(report.cpu_ms),
            total_ms: number(report.total_ms),
            smooth_ms: number(report.smooth_ms),
            deadline_ms: number(report.deadline_ms),
            latency_ms: number(report.latency_ms),
            grids_skipped: report.grids_skipped,
            chosen: report.chosen.into(),
            vehicle: report.vehicle,
            method: report.method,
            scene: report.scene,
            weights_run: report.weights_run,
        }
    }
}

row_table! {
    /// One report of an empty path, whether a frame was planned or not.
    pub(crate) struct StopRow in "stops" {
        recording: u32,
        log_nanos: u64,
        stamp_nanos: u64,
        vehicle: String,
        /// Number of the planned frame; 0 if none was planned.
        frame: u64,
        reason: String,
        detail: String,
    }
}

impl StopRow {
    pub(super) fn new(record: &Record<'_>, report: &PlanReport) -> Self {
        Self {
            recording: record.recording,
            log_nanos: record.message.log_nanos,
            stamp_nanos: report.header.stamp.nanos(),
            vehicle: report.vehicle.clone(),
            frame: report.frame,
            reason: report.reason.clone(),
            detail: report.detail.clone(),
        }
    }
}

row_table! {
    /// One target of a plan report.
    pub(crate) struct TargetRow in "targets" {
        plan: u64,
        index: u32,
        x_m: Option<f64>,
        y_m: Option<f64>,
        yaw_rad: Option<f64>,
        outcome: String,
        cost: Option<f64>,
        bound: Option<f64>,
        length_m: Option<f64>,
        steps: u64,
        time_ms: Option<f64>,
        drivability: String,
    }
}

impl TargetRow {
    pub(super) fn new(plan: u64, index: u32, target: &TargetPlan) -> Self {
        Self {
            plan,
            index,
            x_m: number(target.goal.x_m),
            y_m: number(target.goal.y_m),
            yaw_rad: number(target.goal.yaw_rad),
            outcome: outcome_name(target.status),
            cost: number(target.cost),
            bound: number(target.bound),
            length_m: number(target.length_m),
            steps: target.steps,
            time_ms: number(target.time_ms),
            drivability: drivability_name(target),
        }
    }
}

/// The name of an outcome's code; codes that have none keep their number.
pub(super) fn outcome_name(code: u8) -> String {
    Outcome::from_code(code).map_or_else(
        || format!("unknown_{code}"),
        |outcome| outcome.name().to_owned(),
    )
}

/// How far a path can be driven; empty without a path.
fn drivability_name(target: &TargetPlan) -> String {
    if target.path.is_empty() {
        return String::new();
    }
    let code = target.drivability;
    Drivability::from_code(code).map_or_else(
        || format!("unknown_{code}"),
        |drivability| drivability.name().to_owned(),
    )
}

fn count(len: usize) -> u32 {
    u32::try_from(len).unwrap_or(u32::MAX)
}

fn goals_digest(targets: &[TargetPlan]) -> u64 {
    targets
        .iter()
        .flat_map(|target| [target.goal.x_m, target.goal.y_m, target.goal.yaw_rad])
        .flat_map(f32::to_le_bytes)
        .fold(FNV.0, |digest, byte| {
            (digest ^ u64::from(byte)).wrapping_mul(FNV.1)
        })
}
