//! Differential dynamic programming over the rate of curvature (iLQR with limits on the control).
//!
//! State: x, y, heading, curvature and the step length, which is the same for all steps. Control: the
//! rate at which the curvature changes. Every path that is looked at comes from driving the controls
//! from the start, so it is drivable whatever the costs are; limits of rate and curvature are kept by
//! clamping, and the backward pass knows which of them hold. After Y. Tassa, N. Mansard and
//! E. Todorov, "Control-limited differential dynamic programming" (2014); with a single control the
//! bounded subproblem is a clamp. Deviation: Gauss-Newton terms only, so that no step is uphill.

use super::clothoid::State;
use super::cost::{Cost, Expansion};

/// Steps are halved this often before the search along a direction gives up.
const MAX_HALVINGS: usize = 3;
/// Weight on the square of each pose's change in metres: what keeps a change where the cost is as its
/// expansion says. It grows and falls by a factor.
const LEAST_DAMPING: f64 = 1e-3;
const MOST_DAMPING: f64 = 1e4;
const DAMPING_FACTOR: f64 = 10.0;
/// A path is finished when a full step lets its cost fall by less than this share.
const FINISHED_SHARE: f64 = 1e-3;
/// It is good enough when its cost has fallen by less than this share in a call.
const SETTLED_SHARE: f64 = 0.02;
/// The length may differ from that of the first guess by this share.
const STRETCH_SHARE: f64 = 0.25;

/// Which paths the vehicle can drive.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    pub(super) curvature_per_m: f64,
    pub(super) rate_per_m2: f64,
    /// Whether the path may begin with any curvature.
    pub(super) start_is_free: bool,
}

impl Limits {
    /// Least and greatest rate for a step, and whether each comes from the limit of curvature.
    fn rates(&self, curvature_per_m: f64, step_m: f64) -> [(f64, bool); 2] {
        let down = (-self.curvature_per_m - curvature_per_m) / step_m;
        let up = (self.curvature_per_m - curvature_per_m) / step_m;
        [
            (down.max(-self.rate_per_m2), down > -self.rate_per_m2),
            (up.min(self.rate_per_m2), up < self.rate_per_m2),
        ]
    }

    fn clamp(&self, rate: f64, curvature_per_m: f64, step_m: f64) -> f64 {
        let [(least, _), (most, _)] = self.rates(curvature_per_m, step_m);
        rate.min(most).max(least)
    }
}

/// A path of clothoids of one length.
#[derive(Debug, Clone, Default)]
pub(super) struct Trajectory {
    pub(super) states: Vec<State>,
    /// One less than states, 1/m².
    pub(super) rates_per_m2: Vec<f64>,
    pub(super) step_m: f64,
}

impl Trajectory {
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.states.clone_from(&other.states);
        self.rates_per_m2.clone_from(&other.rates_per_m2);
        self.step_m = other.step_m;
    }
}

/// How far a call has come.
#[derive(Debug, Clone, Copy)]
pub(super) struct Progress {
    pub(super) iterations: usize,
    /// Whether the cost has hardly changed.
    pub(super) is_settled: bool,
    /// Whether it cannot be made to change much more.
    pub(super) is_finished: bool,
}

/// What to change in one step: a constant, and a share of how far the state is off by then.
#[derive(Debug, Clone, Copy, Default)]
struct Gain {
    constant: f64,
    by_state: [f64; 5],
}

/// Change of the start's curvature and of the step length.
#[derive(Debug, Clone, Copy, Default)]
struct StartChange {
    curvature_per_m: f64,
    step_m: f64,
}

/// Improves paths; keeps its memory.
#[derive(Debug, Default)]
pub(super) struct Optimiser {
    damping: f64,
    gains: Vec<Gain>,
    trial: Trajectory,
}

impl Optimiser {
    /// Improves a path until it is finished or `iterations` are used up.
    pub(super) fn improve(
        &mut self,
        cost: &Cost<'_>,
        limits: &Limits,
        path: &mut Trajectory,
        iterations: usize,
    ) -> Progress {
        let before = cost.of(&path.states, &path.rates_per_m2, path.step_m);
        let mut known = before;
        let nominal_m = cost.step_m;
        let mut progress = Progress {
            iterations: 0,
            is_settled: true,
            is_finished: false,
        };
        while progress.iterations < iterations && !progress.is_finished {
            progress.iterations += 1;
            let change = self.backward(cost, limits, path, self.damping);
            let mut share = 1.0;
            let mut halvings = 0;
            let found = loop {
                self.forward(limits, path, (change, share), nominal_m);
                let trial = &self.trial;
                let reached = cost.of(&trial.states, &trial.rates_per_m2, trial.step_m);
                if reached < known {
                    break Some(reached);
                }
                if halvings == MAX_HALVINGS {
                    break None;
                }
                halvings += 1;
                share *= 0.5;
            };
            let Some(reached) = found else {
                self.damping *= DAMPING_FACTOR;
                progress.is_finished = self.damping > MOST_DAMPING;
                continue;
            };
            if halvings == 0 {
                self.damping = (self.damping / DAMPING_FACTOR).max(LEAST_DAMPING);
            } else if halvings > 1 {
                self.damping = (self.damping * DAMPING_FACTOR).min(MOST_DAMPING);
            }
            progress.is_finished = known - reached < FINISHED_SHARE * known && halvings == 0;
            known = reached;
            path.copy_from(&self.trial);
        }
        progress.is_settled = before - known < SETTLED_SHARE * before;
        progress
    }

    /// Forgets how carefully the last path had to be changed.
    pub(super) fn restart(&mut self) {
        self.damping = LEAST_DAMPING;
    }

    /// From the end to the start: the best change of each control as a function of the state.
    fn backward(
        &mut self,
        cost: &Cost<'_>,
        limits: &Limits,
        path: &Trajectory,
        damping: f64,
    ) -> StartChange {
        let steps = path.rates_per_m2.len();
        self.gains.clear();
        self.gains.resize(steps, Gain::default());
        let mut value = Expansion::default();
        cost.of_state(steps, &path.states[steps], Some(&mut value));
        cost.of_end(&path.states[steps], Some(&mut value));
        value.gradient[4] += cost.weights.length * steps as f64;
        for step in (0..steps).rev() {
            let (state, end) = (&path.states[step], &path.states[step + 1]);
            let rate = path.rates_per_m2[step];
            let model = StepModel::new(state, end, (path.step_m, rate));
            let steer = cost.step_m * cost.weights.steer;
            let mut here = model.before(&value);
            cost.of_state(step, state, Some(&mut here.state));
            here.state.damp(damping * cost.step_m);
            here.by_rate += steer * rate;
            here.by_rate_twice += steer;
            let bounds = limits.rates(state.curvature_per_m, path.step_m);
            let gain = here.best_gain(bounds, rate, path.step_m);
            value = here.with(&gain);
            self.gains[step] = gain;
        }
        start_change(&value, limits)
    }

    fn forward(
        &mut self,
        limits: &Limits,
        path: &Trajectory,
        (change, share): (StartChange, f64),
        nominal_m: f64,
    ) {
        let most_m = nominal_m * (1.0 + STRETCH_SHARE);
        let least_m = nominal_m * (1.0 - STRETCH_SHARE);
        let step_m = (path.step_m + share * change.step_m).clamp(least_m, most_m);
        let trial = &mut self.trial;
        trial.step_m = step_m;
        trial.states.clear();
        trial.rates_per_m2.clear();
        let mut state = path.states[0];
        state.curvature_per_m = (state.curvature_per_m + share * change.curvature_per_m)
            .clamp(-limits.curvature_per_m, limits.curvature_per_m);
        trial.states.push(state);
        for ((gain, from), rate) in self.gains.iter().zip(&path.states).zip(&path.rates_per_m2) {
            let off = [
                state.x_m - from.x_m,
                state.y_m - from.y_m,
                state.yaw_rad - from.yaw_rad,
                state.curvature_per_m - from.curvature_per_m,
                step_m - path.step_m,
            ];
            let rate = rate + share * gain.constant + dot(&gain.by_state, &off);
            let rate = limits.clamp(rate, state.curvature_per_m, step_m);
            state = state.after(step_m, rate);
            trial.rates_per_m2.push(rate);
            trial.states.push(state);
        }
    }
}

/// The change of what is free at the start that the value function asks for.
fn start_change(value: &Expansion, limits: &Limits) -> StartChange {
    let (gradient, hessian) = (&value.gradient, &value.hessian);
    let (bend, both, length) = (hessian[3][3], hessian[3][4], hessian[4][4]);
    if !limits.start_is_free {
        return StartChange {
            curvature_per_m: 0.0,
            step_m: if length > 0.0 {
                -gradient[4] / length
            } else {
                0.0
            },
        };
    }
    let determinant = bend * length - both * both;
    if determinant > 0.0 {
        StartChange {
            curvature_per_m: (both * gradient[4] - length * gradient[3]) / determinant,
            step_m: (both * gradient[3] - bend * gradient[4]) / determinant,
        }
    } else {
        StartChange::default()
    }
}

fn dot(a: &[f64; 5], b: &[f64; 5]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// One step, linearised.
struct StepModel {
    /// Rows of the derivatives by the state that are not the identity's.
    x: [f64; 3],
    y: [f64; 3],
    yaw: [f64; 2],
    curvature: f64,
    by_rate: [f64; 5],
}

impl StepModel {
    fn new(state: &State, end: &State, (step_m, rate): (f64, f64)) -> Self {
        let rates = state.rates(end, step_m, rate);
        Self {
            x: [rates.x[0], rates.x[1], rates.x[3]],
            y: [rates.y[0], rates.y[1], rates.y[3]],
            yaw: [rates.yaw[0], rates.yaw[2]],
            curvature: rates.curvature[1],
            by_rate: [
                rates.x[2],
                rates.y[2],
                rates.yaw[1],
                rates.curvature[0],
                0.0,
            ],
        }
    }

    /// A row vector times the derivatives by the state.
    #[inline]
    fn pull(&self, row: &[f64; 5]) -> [f64; 5] {
        let [x, y, yaw, curvature, length] = *row;
        [
            x,
            y,
            x * self.x[0] + y * self.y[0] + yaw,
            x * self.x[1] + y * self.y[1] + yaw * self.yaw[0] + curvature,
            x * self.x[2] + y * self.y[2] + yaw * self.yaw[1] + curvature * self.curvature + length,
        ]
    }

    /// The value function behind a step as a function of state and rate before it.
    fn before(&self, value: &Expansion) -> Before {
        let pulled = value.hessian.map(|row| self.pull(&row));
        let mut hessian = [[0.0; 5]; 5];
        for col in 0..5 {
            let column = self.pull(&std::array::from_fn(|row| pulled[row][col]));
            for (row, entry) in column.into_iter().enumerate() {
                hessian[row][col] = entry;
            }
        }
        let rate_column: [f64; 5] =
            std::array::from_fn(|row| dot(&value.hessian[row], &self.by_rate));
        Before {
            state: Expansion {
                gradient: self.pull(&value.gradient),
                hessian,
            },
            by_rate: dot(&value.gradient, &self.by_rate),
            by_rate_twice: dot(&rate_column, &self.by_rate),
            by_both: self.pull(&rate_column),
        }
    }
}

/// A cost to go as a function of state and rate.
struct Before {
    state: Expansion,
    by_rate: f64,
    by_rate_twice: f64,
    by_both: [f64; 5],
}

impl Before {
    /// The best change of the rate within its limits.
    fn best_gain(&self, [least, most]: [(f64, bool); 2], rate: f64, step_m: f64) -> Gain {
        let free = -self.by_rate / self.by_rate_twice;
        let (limit, is_of_curvature) = if rate + free <= least.0 {
            least
        } else if rate + free >= most.0 {
            most
        } else {
            return Gain {
                constant: free,
                by_state: self.by_both.map(|entry| -entry / self.by_rate_twice),
            };
        };
        // A limit of the rate holds whatever the state is; one of the curvature says where to end.
        let by_state = if is_of_curvature {
            [0.0, 0.0, 0.0, -1.0 / step_m, -limit / step_m]
        } else {
            [0.0; 5]
        };
        Gain {
            constant: limit - rate,
            by_state,
        }
    }

    /// The value function before the step if the gain is followed.
    fn with(&self, gain: &Gain) -> Expansion {
        let mut value = self.state;
        let slope = self.by_rate + self.by_rate_twice * gain.constant;
        for row in 0..5 {
            value.gradient[row] += gain.by_state[row] * slope + self.by_both[row] * gain.constant;
            for col in 0..5 {
                value.hessian[row][col] += gain.by_state[row]
                    * (self.by_rate_twice * gain.by_state[col] + self.by_both[col])
                    + self.by_both[row] * gain.by_state[col];
            }
        }
        value
    }
}
