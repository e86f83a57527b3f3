//! Which of a frame's paths is to be followed.

use serde::{Deserialize, Serialize};
use swath_bridge::{Outcome, Pose2};

use crate::plan::TargetPlan;
use crate::polyline::Polyline;

/// What makes a target worth going to, in metres of progress.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ChoiceConfig {
    /// Worth of a metre along the reference; without one, of a metre from the vehicle.
    pub progress: f64,
    /// Price of a unit of cost, which is a metre driven or a radian turned.
    pub cost: f64,
    /// Price of a metre beside the reference.
    pub aside: f64,
    /// Price of a metre between the target and the one chosen last.
    pub change: f64,
    /// Distance from the one chosen last beyond which its price grows no more, metres.
    pub most_change_m: f64,
}

impl Default for ChoiceConfig {
    fn default() -> Self {
        Self {
            progress: 1.0,
            cost: 0.5,
            aside: 0.5,
            change: 0.75,
            most_change_m: 4.0,
        }
    }
}

/// The number of the target that is worth most, the first of several; only what is solved and drivable
/// at the vehicle's speed counts. `last` is the goal that was chosen before; all are in one frame.
pub fn choose(
    targets: &[TargetPlan],
    reference: &[Pose2],
    last: Option<&Pose2>,
    config: &ChoiceConfig,
) -> Option<usize> {
    let line = Polyline::new(reference);
    let start_m = line
        .nearest(&Pose2::default())
        .map_or(0.0, |(at_m, _)| at_m);
    let worth = |target: &TargetPlan| {
        let (progress_m, aside_m) = match line.nearest(&target.goal) {
            Some((at_m, aside_m)) => (at_m - start_m, aside_m),
            None => (target.goal.distance_m(&Pose2::default()), 0.0),
        };
        let change_m = last.map_or(0.0, |last| {
            last.distance_m(&target.goal).min(config.most_change_m)
        });
        config.progress * progress_m
            - config.cost * target.result.cost
            - config.aside * aside_m
            - config.change * change_m
    };
    let mut best: Option<(usize, f64)> = None;
    for (number, target) in targets.iter().enumerate() {
        let is_drivable = target
            .drivable
            .as_ref()
            .is_some_and(|path| path.is_drivable() && path.points.len() > 1);
        if target.result.outcome != Outcome::Solved || !is_drivable {
            continue;
        }
        let worth = worth(target);
        if best.is_none_or(|(_, most)| worth > most) {
            best = Some((number, worth));
        }
    }
    best.map(|(number, _)| number)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::PathPoint;
    use crate::search::TargetResult;
    use crate::smooth::{Drivability, DrivablePath};

    fn reference() -> Vec<Pose2> {
        (0..60)
            .map(|k| Pose2::new(f64::from(k), 0.0, 0.0))
            .collect()
    }

    fn target((x_m, y_m): (f64, f64), cost: f64, drivability: Drivability) -> TargetPlan {
        TargetPlan {
            goal: Pose2::new(x_m, y_m, 0.0),
            result: TargetResult {
                outcome: Outcome::Solved,
                cost,
                bound: 1.0,
                length_m: cost,
                steps: 1,
                path: Vec::new(),
            },
            cpu: Duration::ZERO,
            drivable: Some(DrivablePath {
                points: vec![PathPoint::default(); 2],
                drivability,
                shortfall: None,
                iterations: 1,
            }),
        }
    }

    fn chosen(targets: &[TargetPlan], last: Option<&Pose2>) -> Option<usize> {
        choose(targets, &reference(), last, &ChoiceConfig::default())
    }

    #[test]
    fn the_farthest_along_the_reference_is_chosen_unless_it_costs_too_much() {
        let at = Drivability::AtSpeed;
        let near = target((20.0, 0.0), 20.0, at);
        assert_eq!(
            chosen(&[near.clone(), target((40.0, 0.0), 41.0, at)], None),
            Some(1)
        );
        assert_eq!(
            chosen(&[near.clone(), target((40.0, 0.0), 90.0, at)], None),
            Some(0)
        );
        assert_eq!(
            chosen(&[near, target((20.0, 3.5), 20.5, at)], None),
            Some(0)
        );
    }

    #[test]
    fn the_last_choice_is_kept_unless_another_is_clearly_better() {
        let at = Drivability::AtSpeed;
        let targets = [
            target((40.0, 0.0), 40.2, at),
            target((40.0, 1.75), 40.4, at),
            target((55.0, 0.0), 55.0, at),
        ];
        let last = Pose2::new(40.0, 1.75, 0.0);
        assert_eq!(chosen(&targets[..2], None), Some(0));
        assert_eq!(chosen(&targets[..2], Some(&last)), Some(1));
        assert_eq!(chosen(&targets, Some(&last)), Some(2));
    }

    #[test]
    fn what_is_flagged_or_has_no_path_is_never_chosen() {
        let mut unsolved = target((50.0, 0.0), f64::NAN, Drivability::AtSpeed);
        unsolved.result.outcome = Outcome::Unreachable;
        let mut unsmoothed = target((45.0, 0.0), 45.0, Drivability::AtSpeed);
        unsmoothed.drivable = None;
        let flagged = [
            Drivability::Slower,
            Drivability::TooTight,
            Drivability::TurnsOnTheSpot,
        ]
        .map(|drivability| target((40.0, 0.0), 40.0, drivability));
        let mut targets = vec![unsolved, unsmoothed];
        targets.extend(flagged);
        assert_eq!(chosen(&targets, None), None);
        targets.push(target((10.0, 5.0), 30.0, Drivability::AtSpeed));
        assert_eq!(chosen(&targets, None), Some(5));
        assert_eq!(chosen(&[], None), None);
    }

    #[test]
    fn without_a_reference_progress_is_distance() {
        let at = Drivability::AtSpeed;
        let targets = [target((10.0, 0.0), 10.0, at), target((0.0, 30.0), 40.0, at)];
        let chosen = choose(&targets, &[], None, &ChoiceConfig::default());
        assert_eq!(chosen, Some(1));
    }
}
