//! Planned frames as messages.

use swath_bridge::Pose2;
use swath_bridge::msg::header::Header;
use swath_bridge::msg::swath::{PlanReport, PlanarPose, TargetPlan as TargetPlanMessage};

use crate::PathPoint;
use crate::frame::{Consulted, FramePlan};
use crate::method::Method;
use crate::plan::TargetPlan;
use crate::smooth::Drivability;
use crate::timing::millis;

/// A plane pose as a message.
#[expect(
    clippy::cast_possible_truncation,
    reason = "the message has single precision"
)]
pub fn planar_pose(pose: &Pose2) -> PlanarPose {
    PlanarPose {
        x_m: pose.x_m as f32,
        y_m: pose.y_m as f32,
        yaw_rad: pose.yaw_rad as f32,
    }
}

/// The pose of a message.
pub fn pose_of_planar(pose: &PlanarPose) -> Pose2 {
    Pose2::new(pose.x_m.into(), pose.y_m.into(), pose.yaw_rad.into())
}

/// The path of a reported target with its curvatures; none where it is chords. Arc lengths are those
/// between the poses.
pub fn path_points(target: &TargetPlanMessage) -> Vec<PathPoint> {
    let mut points: Vec<PathPoint> = Vec::with_capacity(target.curvature_per_m.len());
    for (pose, &curvature) in target.path.iter().zip(&target.curvature_per_m) {
        let pose = pose_of_planar(pose);
        let at_m = points
            .last()
            .map_or(0.0, |last| last.at_m + last.pose.distance_m(&pose));
        points.push(PathPoint {
            pose,
            curvature_per_m: curvature.into(),
            at_m,
        });
    }
    points
}

/// A report of a planned frame in the vehicle's frame. What belongs to a node (vehicle, frame number, latency,
/// weights, the choice) is left for it to fill in.
pub fn plan_report(
    header: Header,
    method: Method,
    speed_m_per_s: f64,
    plan: &FramePlan,
) -> PlanReport {
    plan_report_in(header, method, speed_m_per_s, plan, &Pose2::default())
}

/// The same in the header's frame, in which the vehicle is so.
#[expect(
    clippy::cast_possible_truncation,
    reason = "the message has single precision"
)]
pub fn plan_report_in(
    header: Header,
    method: Method,
    speed_m_per_s: f64,
    plan: &FramePlan,
    frame_from_vehicle: &Pose2,
) -> PlanReport {
    let placed = Placed { frame_from_vehicle };
    let was_tested = plan.start.is_vehicle();
    let targets = plan.targets.iter();
    PlanReport {
        method: method.name().to_owned(),
        consulted: plan.consulted.name().to_owned(),
        network_ms: millis(plan.network) as f32,
        search_ms: millis(plan.search) as f32,
        cpu_ms: millis(plan.cpu) as f32,
        total_ms: millis(plan.total) as f32,
        smooth_ms: millis(plan.smooth) as f32,
        deadline_ms: millis(plan.deadline) as f32,
        start: placed.pose(&plan.start.pose),
        targets: targets
            .map(|target| placed.target(target, was_tested))
            .collect(),
        ..stop_report(header, speed_m_per_s)
    }
}

/// A report for which no frame was planned. Why is left to fill in.
#[expect(
    clippy::cast_possible_truncation,
    reason = "the message has single precision"
)]
pub fn stop_report(header: Header, speed_m_per_s: f64) -> PlanReport {
    PlanReport {
        header,
        vehicle: String::new(),
        frame: 0,
        method: String::new(),
        scene: String::new(),
        speed_m_per_s: speed_m_per_s as f32,
        weights_run: String::new(),
        weights_version: 0,
        weights_age_s: f32::NAN,
        consulted: Consulted::Without.name().to_owned(),
        network_ms: 0.0,
        search_ms: 0.0,
        cpu_ms: 0.0,
        total_ms: 0.0,
        smooth_ms: 0.0,
        deadline_ms: 0.0,
        latency_ms: f32::NAN,
        grids_skipped: 0,
        start: planar_pose(&Pose2::default()),
        chosen: -1,
        targets: Vec::new(),
        reason: String::new(),
        detail: String::new(),
        rejected: Vec::new(),
    }
}

/// Where the vehicle is in the frame of a report.
struct Placed<'a> {
    frame_from_vehicle: &'a Pose2,
}

impl Placed<'_> {
    fn pose(&self, pose: &Pose2) -> PlanarPose {
        if *self.frame_from_vehicle == Pose2::default() {
            return planar_pose(pose);
        }
        planar_pose(&self.frame_from_vehicle.then(pose))
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "the message has single precision"
    )]
    fn target(&self, plan: &TargetPlan, chords_were_tested: bool) -> TargetPlanMessage {
        let curvatures = plan.curvatures_per_m();
        // From elsewhere than the vehicle, chords were only tested on cells that were moved.
        let is_published = chords_were_tested || !curvatures.is_empty();
        let poses = if is_published {
            plan.poses()
        } else {
            Vec::new()
        };
        let drivability = plan.drivable.as_ref().map(|path| path.drivability);
        TargetPlanMessage {
            goal: self.pose(&plan.goal),
            status: plan.result.outcome.code(),
            cost: plan.result.cost,
            bound: plan.result.bound as f32,
            length_m: plan.result.length_m,
            steps: plan.result.steps,
            time_ms: millis(plan.cpu) as f32,
            drivability: drivability.unwrap_or(Drivability::TurnsOnTheSpot).code(),
            path: poses.iter().map(|pose| self.pose(pose)).collect(),
            curvature_per_m: curvatures
                .iter()
                .map(|&curvature| curvature as f32)
                .collect(),
        }
    }
}
