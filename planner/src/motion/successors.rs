//! Which actions may follow each direction at one speed.
//!
//! Actions are numbered by direction, so what may follow a heading is a short run of them, ahead and
//! to both sides, less those that are too short for their turn. It is kept as bits in the same groups
//! of 64 in which a collision map says which actions are blocked.

use std::ops::Range;

use super::{Arrivals, MotionModel, Side, cost_units};
use crate::action::{ACTIONS, Action, DIRECTIONS};
use crate::collision::WORD;

/// Groups of turns.
const TURN_GROUPS: usize = DIRECTIONS / WORD;
/// Directions to the left of a heading, straight back included, and to its right.
const MOST_STEPS: [(Side, u8); 2] = [(Side::Left, 128), (Side::Right, 127)];

/// The actions that may follow each direction at one speed.
#[derive(Debug)]
pub struct Successors {
    headings: Vec<Heading>,
    fans: Vec<Fan>,
    sweeps: Vec<Sweep>,
    /// Number of the first action of each direction, and behind them the number of actions.
    first_actions: Vec<u16>,
    /// By action.
    arrivals: Vec<Arrivals>,
}

#[derive(Debug)]
struct Heading {
    fans: Range<usize>,
    sweeps: Range<usize>,
    /// Farthest that a successor lies to the left and to the right, directions.
    left_steps: u8,
    right_steps: u8,
}

/// The successors of a heading within one group of actions.
#[derive(Debug)]
pub(crate) struct Fan {
    pub(crate) group: usize,
    /// Bit `i` is for action `64 * group + i`.
    pub(crate) allowed: u64,
    /// By bit: turn and length, in units.
    pub(crate) costs: [u32; WORD],
}

/// The turns that a heading's successors pass, within one group.
#[derive(Debug, Clone, Copy)]
struct Sweep {
    group: usize,
    passed: u64,
}

/// The actions whose directions can be turned to, as a run of numbers that may pass the last one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reach {
    first: usize,
    end: usize,
}

impl Reach {
    /// Bits of a group's actions that are in the run.
    #[inline]
    pub(crate) const fn of_group(self, group: usize) -> u64 {
        let from_first = !bits_below(self.first, group);
        let below_end = bits_below(self.end, group);
        if self.first < self.end {
            from_first & below_end
        } else {
            from_first | below_end
        }
    }
}

/// Bits of a group's actions whose number is less than `number`.
const fn bits_below(number: usize, group: usize) -> u64 {
    let bits = number.saturating_sub(group * WORD);
    if bits >= WORD {
        u64::MAX
    } else {
        (1 << bits) - 1
    }
}

impl Successors {
    pub(super) fn new(model: &MotionModel, speed_m_per_s: f64) -> Self {
        let curvature_per_m = model.vehicle.curvature_limit_per_m(speed_m_per_s);
        let actions = model.table.actions();
        let first_action = |direction: usize| {
            let first = actions.partition_point(|a| usize::from(a.direction) < direction);
            u16::try_from(first).unwrap_or(u16::MAX)
        };
        let mut all = Self {
            headings: Vec::with_capacity(DIRECTIONS),
            fans: Vec::new(),
            sweeps: Vec::new(),
            first_actions: (0..=DIRECTIONS).map(first_action).collect(),
            arrivals: actions.iter().map(Arrivals::by).collect(),
        };
        let by_length = |a: &&Action, b: &&Action| a.length_cells.total_cmp(&b.length_cells);
        if let Some(longest) = actions.iter().max_by(by_length) {
            for heading in 0..=u8::MAX {
                all.append(model, heading, (longest, curvature_per_m));
            }
        }
        all
    }

    /// What may come before an action, and what it costs to arrive by it.
    #[inline]
    pub(crate) fn arrivals(&self, action: usize) -> &Arrivals {
        &self.arrivals[action]
    }

    /// Appends what may follow a heading.
    fn append(
        &mut self,
        model: &MotionModel,
        heading: u8,
        (longest, curvature_per_m): (&Action, f64),
    ) {
        let (first_fan, first_sweep) = (self.fans.len(), self.sweeps.len());
        let mut costs = [0u32; ACTIONS];
        let mut allowed = [0u64; ACTIONS.div_ceil(WORD)];
        let mut passed = [0u64; TURN_GROUPS];
        // The limit grows with the action's length, so nothing may turn farther than this one.
        let widest_rad = model.angle_limit_rad(heading, longest, curvature_per_m);
        let farthest = MOST_STEPS.map(|(side, most)| {
            // Straight on is counted to the left only.
            let right = u8::from(side == Side::Right);
            let mut farthest = 0;
            for steps in right..=most {
                let direction = side.turned(heading, steps);
                let angle_rad = model.turn_rad(heading, direction).abs();
                if steps > 1 && angle_rad > widest_rad {
                    break;
                }
                for index in self.actions_of(direction) {
                    let action = &model.table.actions()[index];
                    let limit_rad = model.angle_limit_rad(heading, action, curvature_per_m);
                    if steps <= 1 || angle_rad <= limit_rad {
                        allowed[index / WORD] |= 1 << (index % WORD);
                        costs[index] =
                            cost_units(action.length_cells * model.resolution_m + angle_rad);
                        farthest = steps;
                        self.arrivals[index].add(heading, (side, steps), costs[index]);
                    }
                }
            }
            for turned in 0..farthest {
                let turn = usize::from(side.passed(heading, turned));
                passed[turn / WORD] |= 1 << (turn % WORD);
            }
            farthest
        });
        for (group, &allowed) in allowed.iter().enumerate().filter(|(_, bits)| **bits != 0) {
            let mut of_group = [0; WORD];
            for (to, cost) in of_group.iter_mut().zip(&costs[group * WORD..]) {
                *to = *cost;
            }
            self.fans.push(Fan {
                group,
                allowed,
                costs: of_group,
            });
        }
        for (group, &passed) in passed.iter().enumerate().filter(|(_, bits)| **bits != 0) {
            self.sweeps.push(Sweep { group, passed });
        }
        self.headings.push(Heading {
            fans: first_fan..self.fans.len(),
            sweeps: first_sweep..self.sweeps.len(),
            left_steps: farthest[0],
            right_steps: farthest[1],
        });
    }

    /// Numbers of the actions in a direction.
    pub(crate) fn actions_of(&self, direction: u8) -> Range<usize> {
        let direction = usize::from(direction);
        usize::from(self.first_actions[direction])..usize::from(self.first_actions[direction + 1])
    }

    /// What may follow a heading, by group of actions.
    #[inline]
    pub(crate) fn fans(&self, heading: u8) -> &[Fan] {
        &self.fans[self.headings[usize::from(heading)].fans.clone()]
    }

    /// How far one can turn from a heading, or `None` if no turn that a successor needs is blocked.
    ///
    /// The turn to a direction passes all directions between, so the first one that is blocked ends a
    /// side. `blocked` gives the blocked turns of a group.
    #[inline]
    pub(crate) fn reach(&self, heading: u8, blocked: impl Fn(usize) -> u64) -> Option<Reach> {
        let of_heading = &self.headings[usize::from(heading)];
        let mut groups = [0u64; TURN_GROUPS];
        let mut any = 0;
        for sweep in &self.sweeps[of_heading.sweeps.clone()] {
            groups[sweep.group] = blocked(sweep.group) & sweep.passed;
            any |= groups[sweep.group];
        }
        (any != 0).then(|| self.reach_among(heading, &groups))
    }

    fn reach_among(&self, heading: u8, blocked: &[u64; TURN_GROUPS]) -> Reach {
        let of_heading = &self.headings[usize::from(heading)];
        let free = |side: Side, most: u8| {
            let is_free = |turned: &u8| {
                let turn = usize::from(side.passed(heading, *turned));
                blocked[turn / WORD] >> (turn % WORD) & 1 == 0
            };
            (0..most).take_while(is_free).fold(0u8, |free, _| free + 1)
        };
        let right = Side::Right.turned(heading, free(Side::Right, of_heading.right_steps));
        let left = Side::Left.turned(heading, free(Side::Left, of_heading.left_steps));
        Reach {
            first: usize::from(self.first_actions[usize::from(right)]),
            end: usize::from(self.first_actions[usize::from(left) + 1]),
        }
    }

    /// Mean number of actions that may follow a direction.
    pub fn mean(&self) -> f64 {
        let actions: u32 = self.fans.iter().map(|fan| fan.allowed.count_ones()).sum();
        f64::from(actions) / DIRECTIONS as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use swath_bridge::Vehicle;

    /// The successors of a heading: action, cost in units.
    fn listed(successors: &Successors, heading: u8) -> Vec<(usize, u32)> {
        let of_fan = |fan: &Fan| {
            (0..WORD)
                .filter(|bit| fan.allowed >> bit & 1 != 0)
                .map(|bit| (fan.group * WORD + bit, fan.costs[bit]))
                .collect::<Vec<_>>()
        };
        successors.fans(heading).iter().flat_map(of_fan).collect()
    }

    fn direction_of(model: &MotionModel, action: usize) -> u8 {
        model.table.actions()[action].direction
    }

    #[test]
    fn the_next_direction_to_either_side_is_admitted_at_any_speed() {
        let model = MotionModel::new(&Vehicle::default(), 0.2).unwrap();
        for speed in [0.0, 1.4, 5.0, 30.0] {
            let successors = model.successors(speed);
            for heading in 0..=u8::MAX {
                let list = listed(&successors, heading);
                for neighbour in [heading, heading.wrapping_add(1), heading.wrapping_sub(1)] {
                    assert!(
                        list.iter()
                            .any(|&(action, _)| direction_of(&model, action) == neighbour)
                    );
                }
            }
        }
    }

    proptest! {
        #[test]
        fn just_the_actions_within_the_limit_or_next_to_the_heading_are_admitted(
            heading: u8, speed in 0.0..12.0f64, radius_m in 0.2..8.0f64, resolution_m in 0.2..1.5f64,
        ) {
            let vehicle = Vehicle { min_turning_radius_m: radius_m, ..Vehicle::default() }
                .with_limits_of_its_size();
            let table = crate::action::ActionTable::new();
            let model = MotionModel::without_kernels(&vehicle, resolution_m);
            let curvature = (1.0 / radius_m).min(2.0 / (speed * speed));
            let list = listed(&model.successors(speed), heading);
            for (index, action) in table.actions().iter().enumerate() {
                let turn = model.turn_rad(heading, action.direction).abs();
                let steps = action.direction.wrapping_sub(heading);
                let is_near = steps <= 1 || steps == u8::MAX;
                let expected = is_near || turn <= model.angle_limit_rad(heading, action, curvature);
                let found = list.iter().find(|&&(number, _)| number == index);
                prop_assert_eq!(found.is_some(), expected, "action {}", index);
                if let Some(&(_, cost)) = found {
                    let length_m = action.length_cells * resolution_m;
                    prop_assert_eq!(cost, cost_units(length_m + turn));
                }
            }
        }

        #[test]
        fn a_blocked_turn_hides_what_lies_behind_it(heading: u8, turns in proptest::collection::vec(any::<u8>(), 0..40)) {
            // Slow and on coarse cells, a vehicle may turn to any direction.
            let model = MotionModel::without_kernels(&Vehicle::default(), 10.0);
            let successors = model.successors(0.0);
            let mut blocked = [0u64; TURN_GROUPS];
            for &turn in &turns {
                blocked[usize::from(turn) / WORD] |= 1 << (turn % 64);
            }
            let reach = successors.reach(heading, |group| blocked[group]);
            for (action, _) in listed(&successors, heading) {
                let left = direction_of(&model, action).wrapping_sub(heading);
                let passes = |turn: u8| if left <= 128 {
                    turn.wrapping_sub(heading) < left
                } else {
                    heading.wrapping_sub(turn).wrapping_sub(1) < 0u8.wrapping_sub(left)
                };
                let is_free = !turns.iter().any(|&turn| passes(turn));
                let bit = 1 << (action % WORD);
                let admitted = reach.is_none_or(|reach| reach.of_group(action / WORD) & bit != 0);
                prop_assert_eq!(admitted, is_free);
            }
        }
    }
}
