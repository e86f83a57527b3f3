//! What a node says: plans, the path and regions in the grid's frame, and why there are none.

use std::time::Duration;

use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::{OccupancyGrid, Path};
use swath_bridge::msg::swath::PlanReport;
use swath_bridge::poses::{path_message, pose_of_ros, ros_pose};
use swath_bridge::{
    FREE, GridSpec, OCCUPIED, Occupancy, Pose2, Publisher, Session, StopReason, clock, keys,
};
use tokio::time::Instant;

use super::stops::{Asked, Stop, stop_of};
use super::{Limiter, Node, Planned, Refused, SAY_PERIOD};
use crate::report::{plan_report_in, stop_report};
use crate::{Error, Plane};

/// Everything that a node publishes.
pub(super) struct Outputs {
    plan: Publisher<PlanReport>,
    path: Publisher<Path>,
    region: Publisher<OccupancyGrid>,
}

impl Outputs {
    pub(super) async fn new(session: &Session, id: &str) -> Result<Self, Error> {
        Ok(Self {
            plan: session.publisher(&keys::plan(id)).await?,
            path: session.publisher(&keys::path(id)).await?,
            region: session.publisher(&keys::region(id)).await?,
        })
    }
}

impl Node {
    /// Publishes a planned frame: the report, the chosen path, and the regions for viewing.
    pub(super) async fn publish(&mut self, planned: Planned) -> Result<Option<PlanReport>, Error> {
        let (plan, chosen) = match planned.plan {
            Ok(planned) => planned,
            Err(error) => {
                let grid = planned.grid;
                self.reject("grid", StopReason::Failed.name(), &error);
                let stop = Stop::new(StopReason::Failed, error.to_string());
                return self.refuse(Refused { grid, stop }).await.map(Some);
            }
        };
        let header = planned.grid.message.header;
        self.frame_id.clone_from(&header.frame_id);
        let frame_from_vehicle = planned.vehicle_from_frame.inverse();
        let path = chosen.and_then(|number| plan.targets.get(number));
        let path = path.and_then(|target| Some((target.drivable.as_ref()?, &target.goal)));
        let poses: Vec<Pose2> = if let Some((path, goal)) = path {
            let path = (path.points.as_slice(), goal);
            let followed = self.follower.follow(&planned.departure, path);
            followed.into_iter().map(|point| point.pose).collect()
        } else {
            self.follower.stop();
            Vec::new()
        };
        let poses = moved(poses, &frame_from_vehicle);
        // The controller first: it waits for this.
        self.outputs
            .path
            .put(&path_message(&header, &poses))
            .await?;
        let expires_s = Duration::from_secs_f64(self.config.follow.expires_s);
        self.expires = (!poses.is_empty()).then(|| Instant::now() + expires_s);

        let mut report = plan_report_in(
            header.clone(),
            planned.method,
            planned.speed_m_per_s,
            &plan,
            &frame_from_vehicle,
        );
        self.planned_frames += 1;
        report.frame = self.planned_frames;
        report.chosen = chosen.map_or(-1, |number| i32::try_from(number).unwrap_or(i32::MAX));
        let now = clock::now_nanos();
        if let Some(served) = &planned.network {
            report.weights_run.clone_from(&served.run);
            report.weights_version = served.version;
            if served.stamp_nanos > 0 {
                report.weights_age_s = now.saturating_sub(served.stamp_nanos) as f32 / 1e9;
            }
        }
        report.latency_ms = now.saturating_sub(planned.grid.received_nanos) as f32 / 1e6;
        self.follower.took(f64::from(report.latency_ms) / 1e3);
        if poses.is_empty() {
            let asked = Asked {
                has_reference: planned.has_reference,
                smooth: self.config.plan.smooth,
            };
            self.say_why(&mut report, &stop_of(&plan, asked));
        } else {
            self.say_free();
        }
        let report = self.send(report).await?;
        if let Some(region) = union(&plan.regions) {
            let start = frame_from_vehicle.then(&plan.start.pose);
            let message = region_message(&self.config.grid, &region, header, &start);
            self.outputs.region.put(&message).await?;
        }
        Ok(Some(report))
    }

    /// Says stop because of a grid that is not planned on.
    pub(super) async fn refuse(&mut self, refused: Refused) -> Result<PlanReport, Error> {
        let header = refused.grid.message.header;
        self.frame_id.clone_from(&header.frame_id);
        self.say_stop(header, &refused.stop).await
    }

    /// Says stop because of something that is no grid.
    pub(super) async fn withdraw(&mut self, stop: Stop) -> Result<PlanReport, Error> {
        if self.expires.is_some() {
            tracing::warn!("the last path is withdrawn");
        }
        self.says = Instant::now() + SAY_PERIOD;
        let header = Header::at(clock::now_nanos(), &self.frame_id);
        self.say_stop(header, &stop).await
    }

    /// Why there is nothing to plan on.
    pub(super) fn silence(&self) -> Stop {
        let Some(newest) = self.newest_grid else {
            return Stop::new(StopReason::NoGrid, "");
        };
        let ago_s = newest.elapsed().as_secs_f64();
        match &self.newest_refusal {
            Some(why) => Stop::new(
                StopReason::StaleGrid,
                format!("the newest one, of {ago_s:.1} s ago, was not used: {why}"),
            ),
            None => Stop::new(
                StopReason::StaleGrid,
                format!("the newest one came {ago_s:.1} s ago"),
            ),
        }
    }

    /// Publishes an empty path, and a report that says why.
    async fn say_stop(&mut self, header: Header, stop: &Stop) -> Result<PlanReport, Error> {
        self.expires = None;
        self.follower.stop();
        self.outputs.path.put(&path_message(&header, &[])).await?;
        let mut report = stop_report(header, self.speed_m_per_s);
        self.say_why(&mut report, stop);
        self.send(report).await
    }

    async fn send(&self, mut report: PlanReport) -> Result<PlanReport, Error> {
        report.vehicle.clone_from(&self.config.vehicle_id);
        report.grids_skipped = self.inputs.grid.counts().dropped;
        report.rejected = self.rejections();
        self.outputs.plan.put(&report).await?;
        Ok(report)
    }

    /// Puts into a report why the path is empty, and logs it: a new reason at once, the same one at a
    /// limited rate.
    fn say_why(&mut self, report: &mut PlanReport, stop: &Stop) {
        stop.reason.name().clone_into(&mut report.reason);
        report.detail.clone_from(&stop.detail);
        let (_, limiter) = match &mut self.stopped {
            Some(stopped) if stopped.0 == stop.reason => stopped,
            other => other.insert((stop.reason, Limiter::default())),
        };
        if limiter.is_due(Instant::now()) {
            tracing::warn!("the path is empty: {stop}");
        }
    }

    fn say_free(&mut self) {
        if self.stopped.take().is_some() {
            tracing::info!("there is a path again");
        }
    }
}

/// Poses in another frame.
fn moved(poses: Vec<Pose2>, frame_from_vehicle: &Pose2) -> Vec<Pose2> {
    if *frame_from_vehicle == Pose2::default() {
        return poses;
    }
    let moved = poses.iter().map(|pose| frame_from_vehicle.then(pose));
    moved.collect()
}

/// All cells of several planes.
fn union(planes: &[Plane]) -> Option<Plane> {
    let (first, rest) = planes.split_first()?;
    let mut all = first.clone();
    for plane in rest {
        all.add(plane);
    }
    Some(all)
}

/// A region as a grid, which is turned as the start is in the message's frame.
fn region_message(
    spec: &GridSpec,
    region: &Plane,
    header: Header,
    frame_from_start: &Pose2,
) -> OccupancyGrid {
    let cells = (0..region.len())
        .map(|index| {
            if region.get_index(index) {
                OCCUPIED
            } else {
                FREE
            }
        })
        .collect();
    let occupancy = Occupancy { spec: *spec, cells };
    let mut message = occupancy.to_message(header);
    let origin = pose_of_ros(&message.info.origin);
    message.info.origin = ros_pose(&frame_from_start.then(&origin));
    message
}
