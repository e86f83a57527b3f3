//! Every path of a bench before the independent checker.

use std::collections::BTreeMap;

use swath_bridge::{Outcome, Vehicle};
use swath_planner::check::{CheckLimits, Ends, check_path};
use swath_planner::{FrameInput, FramePlan};

/// What the checker said of paths.
#[derive(Debug, Default)]
pub(super) struct Checked {
    solved: u64,
    drivable: u64,
    violations: BTreeMap<String, u64>,
}

impl Checked {
    /// Checks the paths of a frame.
    pub(super) fn add(
        &mut self,
        vehicle: &Vehicle,
        (input, plan): (&FrameInput<'_>, &FramePlan),
        speed_m_per_s: f64,
    ) {
        let limits = CheckLimits::new(vehicle, vehicle.curvature_limit_per_m(speed_m_per_s));
        for target in &plan.targets {
            self.solved += u64::from(target.result.outcome == Outcome::Solved);
            let path = target.drivable.as_ref().filter(|path| path.is_drivable());
            let Some(path) = path else { continue };
            self.drivable += 1;
            let ends = Ends {
                start: input.start.pose,
                start_curvature_per_m: input.start.curvature_per_m,
                goal: target.goal,
            };
            let ground = (&input.spec, input.obstacles);
            for violation in check_path(ground, &limits, &ends, &path.points) {
                *self
                    .violations
                    .entry(format!("{:?}", violation.fault))
                    .or_default() += 1;
            }
        }
    }

    /// In a line.
    pub(super) fn describe(&self) -> String {
        let share = 100.0 * self.drivable as f64 / self.solved.max(1) as f64;
        let found = if self.violations.is_empty() {
            "nothing wrong with any of them".to_owned()
        } else {
            format!("{:?}", self.violations)
        };
        format!(
            "of {} targets with a path {} can be driven to at the vehicle's speed ({share:.2} %); the \
             checker found {found}",
            self.solved, self.drivable
        )
    }

    /// Whether the checker found anything.
    pub(super) fn is_bad(&self) -> bool {
        !self.violations.is_empty()
    }
}
