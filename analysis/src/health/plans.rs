//! Planning: grids that were planned on or passed over, and how long each took.

use std::collections::BTreeMap;

use polars::prelude::{
    IntoLazy as _, JoinArgs, JoinType, LazyFrame, SortMultipleOptions, col, len, lit,
};
use swath_bridge::keys;

use crate::Error;
use crate::error::InTable as _;
use crate::frames::{counts, names, numbers};
use crate::spread::Spread;
use crate::tables::Tables;

const TABLE: &str = "planner_health";

/// A plan that is ready so soon after its deadline is not late, milliseconds.
pub(crate) const LATE_MS: f64 = 10.0;

/// One vehicle's planner.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PlannerHealth {
    /// Vehicle.
    pub(crate) vehicle: String,
    /// Grids recorded on the vehicle's topic.
    pub(crate) grids: u64,
    /// Grids planned on.
    pub(crate) plans: u64,
    /// Grids that a newer one replaced first, as the planner counted them.
    pub(crate) skipped: u64,
    /// Plans that used a network.
    pub(crate) with_network: u64,
    /// Targets of all plans.
    pub(crate) targets: u64,
    /// Targets to which a path was found.
    pub(crate) solved: u64,
    /// Plans of live grids that chose no path, which tells the vehicle to stop.
    pub(crate) stops: u64,
    /// Why they chose none, as the planner names it; ordered by reason.
    pub(crate) stops_by_reason: BTreeMap<String, u64>,
    /// Plans that were ready more than [`LATE_MS`] after their deadline.
    pub(crate) late: u64,
    /// By how much plans with a deadline passed it; 0 for those that kept it.
    pub(crate) late_ms: Option<Spread>,
    /// From a grid's arrival to its report; of plans of live grids only.
    pub(crate) latency_ms: Option<Spread>,
}

/// What has been seen of a vehicle's planner so far.
#[derive(Default)]
struct Seen {
    grids: u64,
    plans: u64,
    with_network: u64,
    targets: u64,
    solved: u64,
    stops_by_reason: BTreeMap<String, u64>,
    late_ms: Vec<f64>,
    /// Grids skipped before the planner was last restarted.
    skipped_before: u64,
    /// The planner's own count, and the recording that it stands in.
    skipped: (u64, u64),
    latencies_ms: Vec<f64>,
}

impl Seen {
    /// Follows the planner's own count, which only grows until the planner is started anew.
    fn count_skipped(&mut self, recording: u64, skipped: u64) {
        if self.skipped.0 != recording || skipped < self.skipped.1 {
            self.skipped_before = self.skipped_before.saturating_add(self.skipped.1);
        }
        self.skipped = (recording, skipped);
    }
}

/// Each vehicle's planner, ordered by vehicle.
pub(super) fn planners(tables: &Tables) -> Result<Vec<PlannerHealth>, Error> {
    let vehicles = names(&tables.plans, "vehicle", TABLE)?;
    let recordings = counts(&tables.plans, "recording", TABLE)?;
    let versions = counts(&tables.plans, "weights_version", TABLE)?;
    let skipped = counts(&tables.plans, "grids_skipped", TABLE)?;
    let latencies_ms = numbers(&tables.plans, "latency_ms", TABLE)?;
    let deadlines_ms = numbers(&tables.plans, "deadline_ms", TABLE)?;
    let totals_ms = numbers(&tables.plans, "total_ms", TABLE)?;
    let smooth_ms = numbers(&tables.plans, "smooth_ms", TABLE)?;
    let targets = counts(&tables.plans, "targets", TABLE)?;
    let solved = counts(&tables.plans, "solved", TABLE)?;
    let mut planners: BTreeMap<String, Seen> = BTreeMap::new();
    for (vehicle, grids) in grids(tables)? {
        planners.entry(vehicle).or_default().grids = grids;
    }
    for (row, vehicle) in vehicles.into_iter().enumerate() {
        let seen = planners.entry(vehicle).or_default();
        seen.plans += 1;
        seen.targets += targets[row];
        seen.solved += solved[row];
        seen.with_network += u64::from(versions[row] > 0);
        seen.count_skipped(recordings[row], skipped[row]);
        // A plan that did not wait for a grid, as in a benchmark, has no latency.
        if latencies_ms[row] > 0.0 {
            seen.latencies_ms.push(latencies_ms[row]);
        }
        if deadlines_ms[row] > 0.0 {
            let took_ms = totals_ms[row] + smooth_ms[row];
            seen.late_ms.push((took_ms - deadlines_ms[row]).max(0.0));
        }
    }
    for (vehicle, reason) in stopped_frames(tables)? {
        let stops = &mut planners.entry(vehicle).or_default().stops_by_reason;
        *stops.entry(reason).or_default() += 1;
    }
    Ok(planners
        .into_iter()
        .map(|(vehicle, seen)| PlannerHealth {
            vehicle,
            grids: seen.grids,
            plans: seen.plans,
            skipped: seen.skipped_before.saturating_add(seen.skipped.1),
            with_network: seen.with_network,
            targets: seen.targets,
            solved: seen.solved,
            stops: seen.stops_by_reason.values().sum(),
            stops_by_reason: seen.stops_by_reason,
            late: seen.late_ms.iter().filter(|late| **late > LATE_MS).count() as u64,
            late_ms: Spread::of(seen.late_ms),
            latency_ms: Spread::of(seen.latencies_ms),
        })
        .collect())
}

/// Vehicle and reason of each frame that was planned and has no path to follow.
fn stopped_frames(tables: &Tables) -> Result<impl Iterator<Item = (String, String)>, Error> {
    let vehicles = names(&tables.stops, "vehicle", TABLE)?;
    let reasons = names(&tables.stops, "reason", TABLE)?;
    let frames = counts(&tables.stops, "frame", TABLE)?;
    let rows = vehicles.into_iter().zip(reasons).zip(frames);
    Ok(rows.filter(|(_, frame)| *frame > 0).map(|(row, _)| row))
}

/// Reports of empty paths of one vehicle, for one reason.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct StopCount {
    /// Vehicle.
    pub(crate) vehicle: String,
    /// Reason, as the planner names it.
    pub(crate) reason: String,
    /// Reports.
    pub(crate) reports: u64,
    /// The evidence in the newest of them.
    pub(crate) newest_detail: String,
}

/// Reasons of empty paths, ordered by vehicle and reason.
pub(super) fn stops(tables: &Tables) -> Result<Vec<StopCount>, Error> {
    let vehicles = names(&tables.stops, "vehicle", TABLE)?;
    let reasons = names(&tables.stops, "reason", TABLE)?;
    let details = names(&tables.stops, "detail", TABLE)?;
    let mut stops: BTreeMap<(String, String), StopCount> = BTreeMap::new();
    for ((vehicle, reason), detail) in vehicles.into_iter().zip(reasons).zip(details) {
        let count = stops
            .entry((vehicle.clone(), reason.clone()))
            .or_insert_with(|| StopCount {
                vehicle,
                reason,
                reports: 0,
                newest_detail: String::new(),
            });
        count.reports += 1;
        count.newest_detail = detail;
    }
    Ok(stops.into_values().collect())
}

/// Messages of one topic that a vehicle's planner could not use for one cause, over all recordings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct RejectionCount {
    /// Vehicle.
    pub(crate) vehicle: String,
    /// Topic, without the vehicle's part.
    pub(crate) topic: String,
    /// Cause, as the planner names it.
    pub(crate) cause: String,
    /// Messages.
    pub(crate) messages: u64,
}

/// Messages that could not be used, ordered by vehicle, topic and cause.
pub(super) fn rejections(tables: &Tables) -> Result<Vec<RejectionCount>, Error> {
    let vehicles = names(&tables.rejections, "vehicle", TABLE)?;
    let topics = names(&tables.rejections, "topic", TABLE)?;
    let causes = names(&tables.rejections, "cause", TABLE)?;
    let messages = counts(&tables.rejections, "messages", TABLE)?;
    let mut summed: BTreeMap<(String, String, String), u64> = BTreeMap::new();
    for (row, vehicle) in vehicles.into_iter().enumerate() {
        let key = (vehicle, topics[row].clone(), causes[row].clone());
        let sum = summed.entry(key).or_default();
        *sum = sum.saturating_add(messages[row]);
    }
    let summed = summed.into_iter();
    let counts = summed.map(|((vehicle, topic, cause), messages)| RejectionCount {
        vehicle,
        topic,
        cause,
        messages,
    });
    Ok(counts.collect())
}

/// Grids by vehicle.
fn grids(tables: &Tables) -> Result<BTreeMap<String, u64>, Error> {
    let topics = names(&tables.topics, "topic", TABLE)?;
    let messages = counts(&tables.topics, "messages", TABLE)?;
    let mut grids = BTreeMap::new();
    for (topic, messages) in topics.iter().zip(messages) {
        let parts: Vec<&str> = keys::key_of_topic(topic).split('/').collect();
        if let ["swath", "vehicle", vehicle, "grid"] = parts[..] {
            *grids.entry(vehicle.to_owned()).or_insert(0) += messages;
        }
    }
    Ok(grids)
}

/// Targets of a method that had an outcome, or paths that can be driven so far.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct OutcomeCount {
    /// Method.
    pub(crate) method: String,
    /// Outcome.
    pub(crate) outcome: String,
    /// Targets.
    pub(crate) targets: u64,
}

/// Targets by method and outcome, in the order of both names.
pub(super) fn outcomes(tables: &Tables) -> Result<Vec<OutcomeCount>, Error> {
    counted(tables, "outcome", tables.plans.clone().lazy())
}

/// Paths by method and how far they can be driven, of plans that made their paths drivable.
pub(super) fn drivabilities(tables: &Tables) -> Result<Vec<OutcomeCount>, Error> {
    let plans = tables.plans.clone().lazy();
    let plans = plans.filter(col("smooth_ms").gt(lit(0.0)));
    let mut counted = counted(tables, "drivability", plans)?;
    counted.retain(|count| !count.outcome.is_empty());
    Ok(counted)
}

/// Targets of plans by method and what a column says of them.
fn counted(tables: &Tables, said: &str, plans: LazyFrame) -> Result<Vec<OutcomeCount>, Error> {
    let counted = tables
        .targets
        .clone()
        .lazy()
        .select([col("plan"), col(said)])
        .join(
            plans.select([col("plan"), col("method")]),
            [col("plan")],
            [col("plan")],
            JoinArgs::new(JoinType::Inner),
        )
        .group_by([col("method"), col(said)])
        .agg([len().alias("targets")])
        .sort(["method", said], SortMultipleOptions::default())
        .collect()
        .in_table(TABLE)?;
    let methods = names(&counted, "method", TABLE)?.into_iter();
    let outcomes = names(&counted, said, TABLE)?;
    let targets = counts(&counted, "targets", TABLE)?;
    Ok(methods
        .zip(outcomes.into_iter().zip(targets))
        .map(|(method, (outcome, targets))| OutcomeCount {
            method,
            outcome,
            targets,
        })
        .collect())
}
